"""A link of a robot's radio: TCP connections that are carried slowly, or not at all for a while."""

import asyncio
import socket
from asyncio import StreamReader, StreamWriter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from types import TracebackType
from typing import Final, Self

CHUNK: Final = 4096
"""Bytes that are carried at once."""

HELD: Final = 32 << 10
"""Bytes that the system holds for the relay, and waits with: what is held here would count as the link's delay."""


class Relay:
    """Carries what connects to `endpoint` to a port of this machine and back, at `mbit` megabits a second each way.

    While it is down, connections last and carry nothing, and new ones are made and carry nothing either. sleep: waits
    for so many seconds.
    """

    def __init__(self, port: int, mbit: float, sleep: Callable[[float], Awaitable[None]] = asyncio.sleep) -> None:
        self._port = port
        self._sleep = sleep
        self._up = asyncio.Event()
        self._up.set()
        self._carrying: set[asyncio.Task[None]] = set()
        self.mbit = mbit

    async def __aenter__(self) -> Self:
        listening = socket.create_server(("127.0.0.1", 0))
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, HELD)
        self._server = await asyncio.start_server(self._meet, sock=listening, limit=CHUNK)
        self.endpoint = f"tcp/127.0.0.1:{listening.getsockname()[1]}"
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.close()
        for task in self._carrying:
            task.cancel()
        await asyncio.gather(*self._carrying, return_exceptions=True)

    def set_up(self, *, up: bool) -> None:
        """Carry, or do not."""
        if up:
            self._up.set()
        else:
            self._up.clear()

    async def _meet(self, reader: StreamReader, writer: StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None  # noqa: S101 - a server's callback is one
        self._carrying.add(task)
        try:
            await self._up.wait()
            there_reader, there_writer = await asyncio.open_connection("127.0.0.1", self._port, limit=CHUNK)
            try:
                async with asyncio.TaskGroup() as group:
                    group.create_task(self._carry(reader, there_writer))
                    group.create_task(self._carry(there_reader, writer))
            finally:
                there_writer.close()
        except* OSError:
            pass  # one end is gone, and now both are
        finally:
            writer.close()
            self._carrying.discard(task)

    async def _carry(self, reader: StreamReader, writer: StreamWriter) -> None:
        while carried := await reader.read(CHUNK):
            await self._sleep(len(carried) * 8 / (self.mbit * 1e6))
            await self._up.wait()
            writer.write(carried)
            await writer.drain()
        with suppress(OSError):
            writer.write_eof()
