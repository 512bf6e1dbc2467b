"""What a worker that gives a second opinion makes, and what it leaves to the detector."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack

import pytest

from bus import QUEUE, NotServedError
from bus.fake import FakeNetwork
from schemas import codec, consumer_keys, keys, worker_keys
from schemas.budget import RateBudget
from schemas.detections import ClassList
from schemas.keys import Stream
from schemas.status import WorkerStatus
from schemas.tuning import Tuning
from schemas.worker_keys import WorkerAlive
from services.detector.frame_counts import ABOVE_OPINION_RATE
from services.detector.process import DetectorWorker
from services.detector.requests import answering
from services.detector.worker_role import DETECTOR, OPINION
from tests.services.detector.support.fakes import FakeModel
from tests.services.detector.test_worker import FRONT, Rig, frame, loads_after
from tests.waiting import next_of, receive, until

COUNTED = (Stream.CLASSES, Stream.DETECTIONS, Stream.OVERLAY_DETECTION, Stream.OVERLAY_SEGMENTATION)


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    """A worker that gives a second opinion, on a fake bus."""
    network, model = FakeNetwork(), FakeModel()
    async with (
        network.open_bus() as theirs,
        network.open_bus() as ours,
        answering(ours, model, "w1", OPINION),
        asyncio.TaskGroup() as group,
    ):
        tokens = [WorkerAlive(OPINION.service, "w1")]
        working = group.create_task(DetectorWorker(ours, model, tokens, role=OPINION, max_age_s=60, join_s=0).run())
        yield Rig(theirs, model)
        working.cancel()


async def test_a_second_opinion_is_a_class_list_on_a_stream_of_its_own(rig: Rig) -> None:
    async with AsyncExitStack() as stack:
        camera = await stack.enter_async_context(rig.camera(FRONT))
        lists = await stack.enter_async_context(rig.bus.subscribe(FRONT.stream(Stream.OPINION), QUEUE(9)))
        counted = [
            await stack.enter_async_context(rig.bus.subscribe(FRONT.stream(stream), QUEUE(9))) for stream in COUNTED
        ]
        await until(lambda: camera.wanted)
        camera.put(codec.encode(frame(3)))
        seen = await receive(lists, ClassList)
        assert (seen.header.seq, [each.name for each in seen.classes], seen.model) == (3, ["box"], "fake")
        assert [each.counts.received for each in counted] == [0] * len(COUNTED)


@pytest.mark.parametrize("stream", COUNTED)
async def test_who_wants_what_counts_asks_nothing_of_it(rig: Rig, stream: Stream) -> None:
    async with rig.camera(FRONT) as camera:
        async with rig.bus.subscribe(FRONT.stream(stream), QUEUE(9)):
            await asyncio.sleep(0.05)
            assert not camera.wanted
        async with rig.bus.subscribe(FRONT.stream(Stream.OPINION), QUEUE(9)):
            await until(lambda: camera.wanted)
        await until(lambda: not camera.wanted)


async def test_it_is_no_detector_to_others(rig: Rig) -> None:
    async with rig.camera(FRONT), rig.bus.watch("workers/**") as watch:
        tokens = [await next_of(watch), await next_of(watch)]
        assert {worker_keys.parse_worker(token.key) for token in tokens} == {("opinion", "w1")}
        async with rig.bus.subscribe(worker_keys.EVERY_WORKER_STATUS, QUEUE(9)) as statuses:
            status = await receive(statuses, WorkerStatus)
            assert (status.service, status.worker, status.model, status.classes) == ("opinion", "w1", "fake", ["box"])


async def test_it_answers_no_images_but_says_what_it_counts(rig: Rig) -> None:
    with pytest.raises(NotServedError):
        await rig.bus.request(worker_keys.infer("w1"), b"an image", timeout_s=60)
    with pytest.raises(NotServedError):
        await rig.bus.request(worker_keys.worker_settings(DETECTOR.service, "w1"), timeout_s=60)
    reply = await rig.bus.request(worker_keys.worker_settings(OPINION.service, "w1"), timeout_s=60)
    assert codec.decode(Tuning, reply.payload, reply.encoding) == rig.model.tuning


async def test_it_asks_gateways_for_few_frames_from_the_start(rig: Rig) -> None:
    async with (
        rig.camera(FRONT),
        rig.bus.subscribe(consumer_keys.budget(FRONT, "opinion.w1"), QUEUE(9)) as budgets,
        rig.bus.subscribe(FRONT.stream(Stream.OPINION), QUEUE(9)),
    ):
        budget = await receive(budgets, RateBudget)
    assert (budget.consumer, budget.stream, budget.hz) == ("opinion.w1", Stream.COLOR, OPINION.most_hz)


@pytest.mark.parametrize("worker", ["w", "x" * 63 + "1"])
def test_gateways_tell_it_from_a_detector_of_the_same_name(worker: str) -> None:
    consumers = [role.consumer(worker) for role in (DETECTOR, OPINION)]
    assert consumers[0] == worker
    assert consumers[1].startswith("opinion.")
    assert consumers[1][-1] == worker[-1]
    assert all(keys.NAME.fullmatch(consumer) for consumer in consumers)


async def test_one_that_has_more_time_asks_for_no_more() -> None:
    network, model = FakeNetwork(), FakeModel()
    async with (
        network.open_bus() as theirs,
        network.open_bus() as ours,
        Rig(theirs, model).camera(FRONT) as camera,
        theirs.subscribe(consumer_keys.budget(FRONT, "opinion.w1"), QUEUE(9)) as budgets,
        theirs.subscribe(FRONT.stream(Stream.OPINION), QUEUE(9)),
        asyncio.TaskGroup() as group,
    ):
        worker = DetectorWorker(ours, model, [WorkerAlive(OPINION.service, "w1")], role=OPINION, join_s=0)
        working = group.create_task(worker.run())
        await until(lambda: camera.wanted)
        said = [(await receive(budgets, RateBudget)).hz]
        worker._share_pace([FRONT])
        await asyncio.sleep(0.05)
        assert budgets.counts.received == 1, "that another camera came or went is no news of this one"
        for limit_hz in (9.0, 0.5):
            worker._pace.limit_hz = limit_hz
            worker._share_pace([FRONT])
            said.append((await receive(budgets, RateBudget)).hz)
        working.cancel()
    assert said == [2.0, 2.0, 0.5]


async def test_it_looks_at_few_of_many_frames_and_counts_the_others(rig: Rig) -> None:
    async with (
        rig.camera(FRONT) as camera,
        rig.bus.subscribe(FRONT.stream(Stream.OPINION), QUEUE(99)) as lists,
        rig.bus.subscribe(worker_keys.EVERY_WORKER_STATUS, QUEUE(99)) as statuses,
    ):
        await until(lambda: camera.wanted)
        for seq in range(50):
            camera.put(codec.encode(frame(seq)))
            await asyncio.sleep(0.02)
        assert (await receive(lists, ClassList)).header.seq == 0
        load = (await loads_after(statuses, inferred=3))["front"]
        while load.inferred + load.dropped[ABOVE_OPINION_RATE] < 50:
            load = (await loads_after(statuses, inferred=3))["front"]
    assert load.inferred <= 12


async def test_frames_that_it_never_read_are_not_too_many(rig: Rig) -> None:
    async with (
        rig.camera(FRONT) as camera,
        rig.bus.subscribe(FRONT.stream(Stream.OPINION), QUEUE(9)),
        rig.bus.subscribe(worker_keys.EVERY_WORKER_STATUS, QUEUE(99)) as statuses,
    ):
        await until(lambda: camera.wanted)
        for seq in range(5):
            camera.put(codec.encode(frame(seq)))
        assert (await loads_after(statuses, inferred=1))["front"].dropped == {ABOVE_OPINION_RATE: 4}


async def test_it_spares_what_it_did_not_ask_for_though_others_did() -> None:
    network, model = FakeNetwork(), FakeModel()
    async with (
        network.open_bus() as theirs,
        network.open_bus() as ours,
        Rig(theirs, model).camera(FRONT) as camera,
        theirs.subscribe(FRONT.stream(Stream.OPINION), QUEUE(9)),
        theirs.subscribe(worker_keys.EVERY_WORKER_STATUS, QUEUE(99)) as statuses,
        asyncio.TaskGroup() as group,
    ):
        worker = DetectorWorker(ours, model, [WorkerAlive(OPINION.service, "w1")], role=OPINION, max_age_s=60, join_s=0)
        working = group.create_task(worker.run())
        await until(lambda: camera.wanted)
        worker._pace.limit_hz = 0.001
        worker._share_pace([FRONT])
        for seq in range(60):
            camera.put(codec.encode(frame(seq)))
            await asyncio.sleep(0.02)
        load = (await loads_after(statuses, inferred=1))["front"]
        while load.inferred + load.dropped[ABOVE_OPINION_RATE] < 60:
            load = (await loads_after(statuses, inferred=1))["front"]
        working.cancel()
    assert load.inferred <= 2
