"""The world model's worker keeps its sites in files."""

import asyncio
import time
from contextlib import suppress
from pathlib import Path

import pytest

from bus import Reply, Request
from bus.fake import FakeNetwork
from schemas.worker_keys import Serves, WorldStream, every_serves, world_key
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
