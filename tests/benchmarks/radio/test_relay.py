import asyncio
from asyncio import StreamReader, StreamWriter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from benchmarks.radio.relay import CHUNK, Relay
from bus.settings import port_of

PATIENCE_S = 30
MBIT = 2.0


@asynccontextmanager
async def through(slept_s: list[float]) -> AsyncIterator[tuple[Relay, StreamReader, StreamWriter]]:
    """Connect through a relay to what says everything back. slept_s: how long the relay waited each time."""

    async def say_back(reader: StreamReader, writer: StreamWriter) -> None:
        while said := await reader.read(CHUNK):
            writer.write(said)
        writer.close()

    async def sleep(seconds: float) -> None:
        slept_s.append(seconds)

    async with (
        await asyncio.start_server(say_back, "127.0.0.1", 0) as server,
        Relay(server.sockets[0].getsockname()[1], MBIT, sleep) as relay,
        asyncio.timeout(PATIENCE_S),
    ):
        reader, writer = await asyncio.open_connection("127.0.0.1", int(port_of(relay.endpoint)))
        yield relay, reader, writer
        writer.close()


async def test_all_is_carried_both_ways_at_the_links_rate_and_an_end_too() -> None:
    sent = bytes(range(256)) * 1_000
    slept_s: list[float] = []
    async with through(slept_s) as (_, reader, writer):
        writer.write(sent)
        writer.write_eof()
        assert await reader.read(-1) == sent
    assert sum(slept_s) == pytest.approx(2 * len(sent) * 8 / (MBIT * 1e6))


async def test_while_it_is_down_nothing_comes_and_nothing_is_lost() -> None:
    async with through([]) as (relay, reader, writer):
        relay.set_up(up=False)
        writer.write(b"hello")
        waiting = asyncio.create_task(reader.readexactly(5))
        late_reader, late_writer = await asyncio.open_connection("127.0.0.1", int(port_of(relay.endpoint)))
        late_writer.write(b"later")
        late = asyncio.create_task(late_reader.readexactly(5))
        done, _ = await asyncio.wait([waiting, late], timeout=0.2)
        assert not done
        relay.set_up(up=True)
        assert (await waiting, await late) == (b"hello", b"later")
        late_writer.close()


async def test_where_nobody_listens_a_connection_ends() -> None:
    async with await asyncio.start_server(lambda *_: None, "127.0.0.1", 0) as gone:
        port = gone.sockets[0].getsockname()[1]
    async with Relay(port, MBIT) as relay, asyncio.timeout(PATIENCE_S):
        reader, writer = await asyncio.open_connection("127.0.0.1", int(port_of(relay.endpoint)))
        with pytest.raises((asyncio.IncompleteReadError, ConnectionError)):
            await reader.readexactly(1)
        writer.close()
