import asyncio
import io
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import msgspec
import numpy as np
import pytest
from PIL import Image

from bus import Bus, RefusedError, RequestTimeoutError
from bus.fake import FakeNetwork
from bus.sharing import watchdog
from schemas import codec, worker_keys
from schemas.detections import Detections
from schemas.image import ImageFrame
from schemas.tuning import Tuning
from services.detector import requests
from services.detector.model import ModelError
from services.detector.requests import answering
from services.detector.stills import frame_of
from tests.services.detector.support.fakes import FakeModel
from tests.waiting import PATIENCE_S


def png(color: tuple[int, int, int] = (9, 8, 7)) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(np.full((4, 6, 3), color, np.uint8)).save(buffer, "PNG")
    return buffer.getvalue()


@pytest.fixture
def model() -> FakeModel:
    return FakeModel()


@pytest.fixture
async def bus(model: FakeModel) -> AsyncIterator[Bus]:
    network = FakeNetwork()
    async with (
        network.open_bus() as theirs,
        network.open_bus() as ours,
        answering(ours, model, "w1", accept_settings=True),
    ):
        yield theirs


async def tuned(bus: Bus, tuning: Tuning) -> Tuning:
    key = worker_keys.worker_settings("detector", "w1")
    reply = await bus.request(key, codec.encode(tuning), encoding=codec.encoding(Tuning), timeout_s=60)
    return codec.decode(Tuning, reply.payload, reply.encoding)


async def test_an_image_is_answered_with_what_is_in_it(bus: Bus) -> None:
    reply = await bus.request(worker_keys.infer("w1"), png(), timeout_s=60)
    found = codec.decode(Detections, reply.payload, reply.encoding)
    assert (found.height, found.width, found.worker, found.model) == (4, 6, "w1", "fake")
    assert [each.name for each in found.objects] == ["box"]
    assert found.objects[0].mask is not None


@pytest.mark.parametrize(("image", "reason"), [(b"no image", "not an image"), (png(FakeModel.FATAL), "fatal")])
async def test_what_cannot_be_looked_at_is_refused(bus: Bus, image: bytes, reason: str) -> None:
    with pytest.raises(RefusedError, match=reason):
        await bus.request(worker_keys.infer("w1"), image, timeout_s=60)


@asynccontextmanager
async def ended_by(model: FakeModel, reason: str) -> AsyncIterator[Bus]:
    """Answer until the model is of no more use, for that reason."""
    network = FakeNetwork()
    with pytest.raises(ExceptionGroup) as caught:  # noqa: PT012 - what ends it is what is done with the bus
        async with network.open_bus() as theirs, network.open_bus() as ours, answering(ours, model, "w1"):
            yield theirs
            await asyncio.sleep(PATIENCE_S)
    assert caught.group_contains(ModelError, match=reason)


async def test_whoever_asks_a_model_that_works_no_longer_hears_why_and_the_worker_ends() -> None:
    async with ended_by(FakeModel(broken=True), r"^no memory$") as bus:
        with pytest.raises(RefusedError, match=r"^busy: this worker is shutting down: no memory$"):
            await bus.request(worker_keys.infer("w1"), png(), timeout_s=60)


async def test_a_model_that_never_answers_ends_the_worker_also_when_nobody_waits_any_longer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(watchdog, "CHECK_S", 0.02)
    model = FakeModel()
    model.may_answer.clear()
    async with ended_by(model, r"^fake has not answered for 1\.2 s$") as bus:
        with pytest.raises((RequestTimeoutError, RefusedError), match=r"no answer within|not done in time"):
            await bus.request(worker_keys.infer("w1"), png(), timeout_s=0.1)
        with pytest.raises(RefusedError, match="busy: still processing an image"):
            await bus.request(worker_keys.infer("w1"), png(), timeout_s=60)
    model.may_answer.set()


async def test_a_worker_that_has_enough_to_do_says_so_at_once(bus: Bus, model: FakeModel) -> None:
    model.may_answer.clear()
    async with asyncio.TaskGroup() as group:
        waiting = [group.create_task(bus.request(worker_keys.infer("w1"), png(), timeout_s=60)) for _ in range(3)]
        assert await asyncio.to_thread(model.called.acquire, timeout=60)
        with pytest.raises(RefusedError, match="busy:"):
            await bus.request(worker_keys.infer("w1"), png(), timeout_s=60)
        model.may_answer.set()
        await asyncio.gather(*waiting)


async def test_an_image_whose_caller_waits_no_longer_is_decoded_alone(
    bus: Bus, model: FakeModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, may_end, threads = threading.Semaphore(0), threading.Event(), list[str]()

    def decode(data: bytes) -> ImageFrame:
        threads.append(threading.current_thread().name)
        begun.release()
        assert may_end.wait(60)
        return frame_of(data)

    monkeypatch.setattr(requests, "frame_of", decode)
    # The worker keeps the caller's deadline too: on a busy machine its word may come first.
    with pytest.raises((RequestTimeoutError, RefusedError), match=r"no answer within|not done in time"):
        await bus.request(worker_keys.infer("w1"), png(), timeout_s=0.1)
    assert await asyncio.to_thread(begun.acquire, timeout=60)
    with pytest.raises(RefusedError, match="busy: still decoding an image"):
        await bus.request(worker_keys.infer("w1"), png(), timeout_s=60)
    may_end.set()
    while True:
        try:
            await bus.request(worker_keys.infer("w1"), png(), timeout_s=60)
        except RefusedError:
            await asyncio.sleep(0.01)
        else:
            break
    assert len(threads) == 2
    assert len(set(threads)) == 1
    assert len(model.seen) == 1


async def test_settings_are_told_and_changed_one_by_one(bus: Bus, model: FakeModel) -> None:
    reply = await bus.request(worker_keys.worker_settings("detector", "w1"), timeout_s=60)
    assert codec.decode(Tuning, reply.payload, reply.encoding) == model.tuning
    changed = await tuned(bus, Tuning(confidence=0.9))
    assert changed == model.tuning == Tuning(confidence=0.9, iou=0.7, max_detections=300, classes=[])


async def test_settings_are_told_but_not_changed_unless_the_worker_accepts_that(model: FakeModel) -> None:
    network = FakeNetwork()
    async with network.open_bus() as theirs, network.open_bus() as ours, answering(ours, model, "w1"):
        before = model.tuning
        with pytest.raises(RefusedError, match="--accept-settings"):
            await tuned(theirs, Tuning(confidence=1.0))
        reply = await theirs.request(worker_keys.worker_settings("detector", "w1"), timeout_s=60)
        assert codec.decode(Tuning, reply.payload, reply.encoding) == model.tuning == before


async def test_settings_that_cannot_be_are_refused_and_change_nothing(bus: Bus, model: FakeModel) -> None:
    before = model.tuning
    with pytest.raises(RefusedError, match="no class is called 'unicorn'"):
        await tuned(bus, Tuning(classes=["unicorn"]))
    with pytest.raises(RefusedError, match="Tuning"):
        await bus.request(
            worker_keys.worker_settings("detector", "w1"), b"\x81", encoding=codec.encoding(Tuning), timeout_s=60
        )
    with pytest.raises(RefusedError, match="unknown field `confidense`"):
        await bus.request(
            worker_keys.worker_settings("detector", "w1"),
            msgspec.msgpack.encode({"iou": 0.1, "confidense": 0.9}),
            encoding=codec.encoding(Tuning),
            timeout_s=60,
        )
    assert model.tuning == before
