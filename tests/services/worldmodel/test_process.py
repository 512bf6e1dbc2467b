"""The world model's worker keeps its sites in files."""

import asyncio
import time
from contextlib import suppress
from pathlib import Path

import pytest

from bus import Reply, Request
from bus.fake import FakeNetwork
from bus.sharing.camera_assignment import owner
from schemas.worker_keys import Serves, WorkerAlive, WorldStream, every_serves, world_key
from services.worldmodel import process
from services.worldmodel.process import SERVICE, WorldWorker
from services.worldmodel.settings import WorldSettings
from services.worldmodel.site import site_key
from tests.waiting import until


async def test_a_state_that_is_being_written_is_whole_before_the_last_one_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[str] = []

    def write(_: Path, state: bytes) -> None:
        steps.append(f"begin {state.decode()}")
        time.sleep(0.2)
        steps.append(f"end {state.decode()}")

    monkeypatch.setattr(process, "_write", write)
    states = asyncio.Queue[bytes](1)
    states.put_nowait(b"1")
    writing = asyncio.create_task(process._write_all(tmp_path / "main.world", states))
    async with asyncio.timeout(5):
        while not steps:  # noqa: ASYNC110 - a thread writes
            await asyncio.sleep(0.01)
    writing.cancel()
    with suppress(asyncio.CancelledError):
        await writing
    assert steps == ["begin 1", "end 1"]


async def test_a_new_worker_leaves_a_site_alone_that_is_answered_for_before_its_token_has_come() -> None:
    answered: list[Request] = []

    async def answer(request: Request) -> Reply:
        answered.append(request)
        return Reply(b"", "")

    network = FakeNetwork()
    key = site_key("hall")
    async with (
        network.open_bus() as theirs,
        network.open_bus() as ours,
        theirs.serve(world_key("hall", WorldStream.OBJECTS), answer),
        theirs.watch(every_serves(SERVICE)) as watch,
        asyncio.timeout(30),
    ):
        working = asyncio.create_task(WorldWorker(ours, WorldSettings(sites=["hall=*"], worker="w2")).run())
        await until(lambda: answered)
        async with theirs.announce(str(Serves(SERVICE, "w1", key))):
            assert (await anext(watch)).key == str(Serves(SERVICE, "w1", key))
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(anext(watch), 1.5)
        working.cancel()
        await asyncio.wait([working])


async def test_of_two_workers_that_serve_a_site_one_stands_by(caplog: pytest.LogCaptureFixture) -> None:
    """Each took it while a link between them was cut."""
    key = site_key("hall")
    names = [f"w{number}" for number in range(10)]
    winner = owner(key, [WorkerAlive(SERVICE, name) for name in names])
    assert winner is not None
    loser = next(name for name in names if name != winner)
    network = FakeNetwork()
    tokens: set[str] = set()
    async with (
        network.open_bus() as theirs,
        network.open_bus() as ours,
        theirs.watch(every_serves(SERVICE)) as watch,
        asyncio.timeout(30),
    ):

        async def look() -> None:
            async for presence in watch:
                (tokens.add if presence.alive else tokens.discard)(presence.key)

        looking = asyncio.create_task(look())
        working = asyncio.create_task(WorldWorker(ours, WorldSettings(sites=["hall=*"], worker=loser)).run())
        own, other = (str(Serves(SERVICE, name, key)) for name in (loser, winner))
        await until(lambda: own in tokens)
        async with theirs.announce(other):
            await until(lambda: own not in tokens)
            assert f"site hall: worker {winner} serves it, too; this one stands by" in caplog.text
        await until(lambda: own in tokens)
        for task in (working, looking):
            task.cancel()
        await asyncio.wait([working, looking])
