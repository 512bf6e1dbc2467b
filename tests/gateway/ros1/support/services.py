"""ROS services of tests: what a service sends is what the test says."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from gateway.ros1.tcpros.service_client import TRIGGER
from gateway.ros1.wire.header import LENGTH, encode_header

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from gateway.ros1.master import MasterClient
    from gateway.ros1.wire.tcpros import TopicType


class FakeService:
    """Sends `header` when it has the caller's, and `answer` when it has the request; then closes, or hangs."""

    def __init__(self, header: bytes, answer: bytes, *, hang: bool) -> None:
        self.requests: list[bytes] = []
        self.connections = 0
        self._header = header
        self._answer = answer
        self._hang = hang
        self._serving: set[asyncio.Task[None]] = set()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._serving.add(task)
        self.connections += 1
        try:
            await _frame(reader)
            writer.write(self._header)
            self.requests.append(await _frame(reader))
            writer.write(self._answer)
            while self._hang and await reader.read(4096):
                pass
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            return
        finally:
            writer.transport.abort()

    async def end(self) -> None:
        for task in self._serving:
            task.cancel()
        await asyncio.gather(*self._serving)


async def _frame(reader: asyncio.StreamReader) -> bytes:
    (length,) = LENGTH.unpack(await reader.readexactly(LENGTH.size))
    return await reader.readexactly(length)


def service_header(kind: TopicType = TRIGGER) -> bytes:
    return encode_header({"callerid": "/motor", "type": kind.name, "md5sum": kind.md5sum})


def answer(data: bytes, *, ok: bool = True) -> bytes:
    return bytes([ok]) + LENGTH.pack(len(data)) + data


@asynccontextmanager
async def fake_service(
    master: MasterClient, name: str, header: bytes, answered: bytes = b"", *, hang: bool = False
) -> AsyncIterator[FakeService]:
    """Register a service at a master."""
    service = FakeService(header, answered, hang=hang)
    listener = await asyncio.start_server(service.serve, "127.0.0.1", 0)
    uri = f"rosrpc://127.0.0.1:{listener.sockets[0].getsockname()[1]}"
    await master.call("registerService", name, uri, "http://127.0.0.1:1/")
    try:
        yield service
    finally:
        await master.call("unregisterService", name, uri)
        listener.close()
        await service.end()
        await listener.wait_closed()
