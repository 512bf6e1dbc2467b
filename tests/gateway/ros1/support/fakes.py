"""Peers that misbehave: a publisher's slave API whose TCPROS port sends what the test says."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from gateway.ros1.xmlrpc.server import XmlRpcServer

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable


@dataclass
class FakeSlave:
    """Answers every call with what `answer` returns for it, and remembers it."""

    answer: Callable[[str, tuple[Any, ...]], Any]
    calls: list[tuple[str, tuple[Any, ...]]] = field(default_factory=list)

    def call(self, method: str, params: tuple[Any, ...]) -> tuple[str, Any]:
        self.calls.append((method, params))
        return "", self.answer(method, params)


@asynccontextmanager
async def fake_publisher(stream: bytes, *, hang: bool = False) -> AsyncIterator[str]:
    """Serve requestTopic and send `stream` to whoever connects; then close, or `hang`. Yields the slave URI."""
    writers: list[asyncio.StreamWriter] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writers.append(writer)
        await reader.read(4096)
        writer.write(stream)
        while hang and await reader.read(4096):
            pass
        writer.close()

    listener = await asyncio.start_server(serve, "127.0.0.1", 0)
    port = listener.sockets[0].getsockname()[1]
    slave = FakeSlave(lambda _method, _params: ["TCPROS", "127.0.0.1", port])
    try:
        async with XmlRpcServer(slave, host="127.0.0.1") as server:
            yield server.uri
    finally:
        listener.close()
        for writer in writers:
            writer.transport.abort()
        await asyncio.gather(*(writer.wait_closed() for writer in writers), return_exceptions=True)
        await listener.wait_closed()
