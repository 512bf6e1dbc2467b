"""Cancelled at any await, a worker leaves nothing: no task, subscription or token."""

import asyncio
from contextlib import AsyncExitStack

import pytest

from bus import QUEUE
from bus.fake import FakeNetwork
from bus.sharing import sharing
from schemas import codec
from schemas.keys import Stream
from services.cloud.process import CloudWorker
from services.cloud.settings import CloudSettings
from tests.gateway.ros1.support.cancelling import cancel_everywhere
from tests.services.cloud.test_worker import FRONT, Rig, found, registered
from tests.services.inline_executor import InlineExecutor
from tests.waiting import until

SENT = {Stream.POINTS: codec.encode(registered(3)), Stream.DETECTIONS: codec.encode(found(3))}


async def test_a_worker_with_a_wanted_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sharing, "SETTLE_S", 0)  # nothing waits for a time, so the number of turns is always the same
    network, settings = FakeNetwork(), CloudSettings(worker="w1")
    async with AsyncExitStack() as stack:
        executor = InlineExecutor()
        theirs = await stack.enter_async_context(network.open_bus())
        front = await Rig(theirs, stack).camera(FRONT, Stream.COLOR, Stream.POINTS, Stream.DETECTIONS)
        objects = await stack.enter_async_context(theirs.subscribe(FRONT.stream(Stream.OBJECTS), QUEUE(9)))

        async def life() -> None:
            before = objects.counts.received
            async with network.open_bus() as ours, asyncio.TaskGroup() as group:
                worker = CloudWorker(ours, settings, executor, join_s=0)
                working = group.create_task(worker.run())
                sent = False
                while objects.counts.received == before:  # each turn of the loop is a suspension
                    if not sent and all(front[stream].wanted for stream in SENT):
                        sent = True
                        for stream, message in SENT.items():
                            front[stream].put(message)
                    await asyncio.sleep(0)
                working.cancel()

        async def nothing_is_left(n: int) -> None:
            await until(lambda: not any(each.wanted for each in front.values()), f"nothing is subscribed after {n}")

        assert await cancel_everywhere(life, nothing_is_left) > 10
