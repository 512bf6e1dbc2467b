"""Cancelled at any await, a worker leaves nothing: no task, subscription or token."""

import asyncio

import pytest

from bus import QUEUE
from bus.fake import FakeNetwork
from bus.sharing import sharing
from schemas.keys import Stream
from tests.gateway.ros1.support.cancelling import cancel_everywhere
from tests.services.distance.rig import FRONT, robot, working
from tests.services.distance.scenes import depth, detections, found, mask, wall
from tests.services.inline_executor import InlineExecutor
from tests.waiting import until

BOX = found(mask(slice(10, 30), slice(20, 50)))


async def test_a_worker_with_a_wanted_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sharing, "SETTLE_S", 0)  # nothing waits for a time, so the number of turns is always the same
    network = FakeNetwork()
    async with (
        network.open_bus() as theirs,
        robot(theirs) as front,
        theirs.subscribe(FRONT.stream(Stream.DISTANCES), QUEUE(9)) as distances,
    ):

        async def life() -> None:
            before = distances.counts.received
            async with network.open_bus() as ours, working(ours, InlineExecutor()):
                while distances.counts.received == before:  # each turn of the loop is a suspension
                    if front.wanted(Stream.DETECTIONS) and front.wanted(Stream.DEPTH):
                        front.send(Stream.DEPTH, depth(wall(2.0)))
                        front.send(Stream.DETECTIONS, detections(BOX))
                    await asyncio.sleep(0)

        async def nothing_is_left(n: int) -> None:
            await until(lambda: not front.wanted(Stream.DEPTH), f"nothing is subscribed after {n}")

        assert await cancel_everywhere(life, nothing_is_left) > 10
