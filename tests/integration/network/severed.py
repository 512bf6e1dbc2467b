"""A TCP connection that can be cut for a while."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from gateway.ros1.tasks import TaskScope

CHUNK = 1 << 16


class Severable:
    """Hands on what comes in, both ways. While it is cut nothing gets through, and there are no new connections.

    received: bytes that were handed on to those that connect. sent: from these.
    """

    def __init__(self, to_port: int) -> None:
        self.cut = False
        self.port = 0
        self.received = self.sent = 0
        self._to_port = to_port
        self._writers: set[asyncio.StreamWriter] = set()

    def sever(self) -> None:
        """End all connections and refuse others."""
        self.cut = True
        for writer in self._writers:
            writer.transport.abort()

    def mend(self) -> None:
        """Let connections through again."""
        self.cut = False

    async def connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection."""
        if self.cut:
            writer.transport.abort()
            return
        to_reader, to_writer = await asyncio.open_connection("127.0.0.1", self._to_port)
        both = {writer, to_writer}
        self._writers |= both
        try:
            async with TaskScope() as scope:
                scope.start(_copy(to_reader, writer, self._count), "back")
                await _copy(reader, to_writer, self._count_sent)
        finally:
            self._writers -= both
            for each in both:
                each.transport.abort()

    def _count(self, size: int) -> None:
        self.received += size

    def _count_sent(self, size: int) -> None:
        self.sent += size


async def _copy(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, count: Callable[[int], None] = lambda _: None
) -> None:
    with contextlib.suppress(ConnectionError):
        while data := await reader.read(CHUNK):
            count(len(data))
            writer.write(data)
            await writer.drain()
    writer.transport.abort()


@asynccontextmanager
async def severable(to_port: int) -> AsyncIterator[Severable]:
    """Listen on `port` for connections to a port of this machine."""
    link = Severable(to_port)
    async with TaskScope() as scope:

        def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            scope.start(link.connect(reader, writer), "severable link")

        async with await asyncio.start_server(accept, "127.0.0.1", 0) as server:
            link.port = server.sockets[0].getsockname()[1]
            yield link
