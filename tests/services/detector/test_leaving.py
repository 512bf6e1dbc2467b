"""A worker that leaves finishes what it has begun."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from bus import QUEUE, Bus, NotServedError, QoS, RefusedError
from bus.fake import FakeNetwork
from schemas import codec, worker_keys
from schemas.detections import ClassList, Detections
from schemas.image import ImageFrame
from schemas.keys import Stream
from services.detector import process
from services.detector.process import work
from services.detector.requests import FINISH_S
from services.detector.settings import DetectorSettings
from services.toolbox.demo.children import STOP_S
from services.toolbox.process import DEADLINE_S
from tests.services.detector.support.fakes import FakeModel
from tests.services.detector.test_requests import png
from tests.services.detector.test_worker import FRONT, frame
from tests.waiting import PATIENCE_S, receive, until

LONG_S = 0.7
"""Longer than anything but the model takes."""


@pytest.fixture
async def bus(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Bus]:
    """Give the fleet's bus; processes open theirs on the same network."""
    network = FakeNetwork()
    monkeypatch.setattr(process, "open_bus", lambda _: network.open_bus())
    async with network.open_bus() as theirs:
        yield theirs


@asynccontextmanager
async def working(model: FakeModel) -> AsyncIterator[asyncio.Task[int]]:
    task = asyncio.create_task(work(DetectorSettings(worker="w1", tracker="off", max_age_s=60), model))
    yield task
    model.may_answer.set()
    task.cancel()
    await asyncio.wait([task])


async def called(model: FakeModel) -> None:
    assert await asyncio.to_thread(model.called.acquire, timeout=PATIENCE_S)


async def test_the_frame_in_the_model_is_published_and_drawn(bus: Bus) -> None:
    model = FakeModel()
    async with (
        working(model) as worker,
        bus.publisher(FRONT.stream(Stream.COLOR), QoS.IMAGE, encoding=codec.encoding(ImageFrame)) as camera,
        bus.announce(FRONT.alive(Stream.COLOR)),
        bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)) as classes,
        bus.subscribe(FRONT.stream(Stream.DETECTIONS), QUEUE(9)) as detections,
        bus.subscribe(FRONT.stream(Stream.OVERLAY_DETECTION), QUEUE(9)) as boxes,
        bus.subscribe(FRONT.stream(Stream.OVERLAY_SEGMENTATION), QUEUE(9)) as masks,
    ):
        await until(lambda: camera.wanted)
        model.may_answer.clear()
        camera.put(codec.encode(frame(7)))
        await called(model)
        worker.cancel()
        await until(lambda: not camera.wanted)
        with pytest.raises(RefusedError, match="busy: this worker is shutting down"):
            await bus.request(worker_keys.infer("w1"), png(), timeout_s=PATIENCE_S)
        await asyncio.wait([worker], timeout=LONG_S)
        assert not worker.done()
        model.may_answer.set()
        assert (await receive(classes, ClassList)).header.seq == 7
        assert (await receive(detections, Detections)).header.seq == 7
        for overlay in (boxes, masks):
            assert (await receive(overlay, ImageFrame)).header.seq == 7
        await asyncio.wait([worker])


async def test_the_image_that_is_looked_at_is_answered_and_no_other_one_is_begun(bus: Bus) -> None:
    model = FakeModel()
    async with working(model) as worker, bus.watch(worker_keys.every_worker_alive("detector")) as presence:
        assert (await anext(presence)).alive
        model.may_answer.clear()
        answer, waiting = (
            asyncio.create_task(bus.request(worker_keys.infer("w1"), png(), timeout_s=PATIENCE_S)) for _ in range(2)
        )
        await called(model)
        worker.cancel()
        assert not (await anext(presence)).alive
        await asyncio.wait([worker], timeout=LONG_S)
        assert not worker.done()
        model.may_answer.set()
        reply = await answer
        assert [each.name for each in codec.decode(Detections, reply.payload, reply.encoding).objects] == ["box"]
        with pytest.raises(NotServedError):
            await waiting
        await asyncio.wait([worker])
    assert len(model.seen) == 1


async def test_what_never_ends_is_not_waited_for(bus: Bus) -> None:
    model = FakeModel()
    async with (
        working(model) as worker,
        bus.publisher(FRONT.stream(Stream.COLOR), QoS.IMAGE, encoding=codec.encoding(ImageFrame)) as camera,
        bus.announce(FRONT.alive(Stream.COLOR)),
        bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)),
    ):
        await until(lambda: camera.wanted)
        model.may_answer.clear()
        camera.put(codec.encode(frame(7)))
        await called(model)
        worker.cancel()
        done, _ = await asyncio.wait([worker], timeout=PATIENCE_S)
        assert done
    assert FINISH_S < STOP_S < DEADLINE_S
