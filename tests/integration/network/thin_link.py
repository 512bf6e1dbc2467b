"""A TCP connection that carries no more than so many bytes a second in one direction."""

import asyncio
import contextlib
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Final

from gateway.ros1.tasks import TaskScope

SEGMENT: Final = 1_500
BURST_S: Final = 0.02


class ThinLink:
    """Hands on what comes in at `bytes_per_s`, holding next to nothing itself. passed: how many bytes that was."""

    def __init__(self, to_port: int, bytes_per_s: float) -> None:
        self.passed = 0
        self._to_port = to_port
        self._rate = bytes_per_s
        self._free_at_s = 0.0

    async def connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection."""
        to_reader, to_writer = await asyncio.open_connection("127.0.0.1", self._to_port)
        try:
            async with TaskScope() as scope:
                scope.start(_copy(to_reader, writer), "back")
                with contextlib.suppress(ConnectionError):
                    await self._throttle(reader, to_writer)
        finally:
            for ended in (writer, to_writer):
                ended.close()

    async def _throttle(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(SEGMENT):
            writer.write(data)
            self.passed += len(data)
            now_s = time.monotonic()
            self._free_at_s = max(self._free_at_s, now_s - BURST_S) + len(data) / self._rate
            await asyncio.sleep(max(0.0, self._free_at_s - now_s))


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(ConnectionError):
        while data := await reader.read(SEGMENT):
            writer.write(data)


@asynccontextmanager
async def thin_link(to_port: int, bytes_per_s: float) -> AsyncIterator[tuple[ThinLink, int]]:
    """Listen for connections to a port of this machine; give the link and the port that it listens on."""
    link = ThinLink(to_port, bytes_per_s)
    with socket.socket() as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8_192)
        listening.bind(("127.0.0.1", 0))
        async with TaskScope() as scope:

            def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
                scope.start(link.connect(reader, writer), "thin link")

            async with await asyncio.start_server(accept, sock=listening, limit=SEGMENT):
                yield link, listening.getsockname()[1]
