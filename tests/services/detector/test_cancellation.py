"""Cancelled at any await, a worker leaves nothing: no task, declaration or token."""

import asyncio

import pytest

from bus import QUEUE, QoS
from bus.fake import FakeNetwork
from bus.sharing import sharing
from schemas import codec
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from schemas.worker_keys import WorkerAlive
from services.detector.process import DetectorWorker
from tests.gateway.ros1.support.cancelling import cancel_everywhere
from tests.services.detector.support.fakes import FakeModel
from tests.services.detector.test_worker import frame
from tests.waiting import until

ME = WorkerAlive("detector", "w1")
FRONT = CameraKey("r1", "front")


async def test_a_worker_with_a_wanted_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sharing, "SETTLE_S", 0)  # nothing waits for a time, so the number of turns is always the same
    network = FakeNetwork()
    async with (
        network.open_bus() as theirs,
        theirs.announce(FRONT.alive(Stream.COLOR)),
        theirs.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)) as classes,
        theirs.publisher(FRONT.stream(Stream.COLOR), QoS.IMAGE, encoding=codec.encoding(ImageFrame)) as camera,
    ):

        async def life() -> None:
            before = classes.counts.received
            async with network.open_bus() as ours, asyncio.TaskGroup() as group:
                working = group.create_task(DetectorWorker(ours, FakeModel(), [ME], max_age_s=60, join_s=0).run())
                while classes.counts.received == before:  # each turn of the loop is a suspension
                    if camera.wanted:
                        camera.put(codec.encode(frame(0)))
                    await asyncio.sleep(0)
                working.cancel()

        async def nothing_is_left(n: int) -> None:
            await until(lambda: not camera.wanted, f"nothing is subscribed after {n}")

        assert await cancel_everywhere(life, nothing_is_left) > 10
