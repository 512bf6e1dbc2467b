import asyncio
from collections.abc import AsyncIterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Any

import pytest

from bus import Publisher as BusPublisher
from bus.fake import FakeNetwork
from bus.sharing.work_counts import Tally
from schemas import codec
from schemas.keys import Stream
from schemas.objects import ObjectClouds
from schemas.status import UNWANTED
from services.cloud.camera import POINTS_WAITING, CloudCamera
from services.cloud.measuring import CloudLimits
from services.cloud.waiting import FAILED, TOO_MANY_POINTS
from services.geometry.memory_budget import MemoryBudget
from tests.services.cloud.test_worker import FRONT, Rig, found, registered
from tests.waiting import until


class Publisher:
    """Takes what is published, after so many failures."""

    def __init__(self, failures: int = 0) -> None:
        self.taken: list[ObjectClouds] = []
        self._failures = failures

    def put(self, clouds: ObjectClouds) -> None:
        if self._failures:
            self._failures -= 1
            raise ValueError("no message")
        self.taken.append(clouds)


def answered(tally: Tally, count: int) -> bool:
    return tally.done + tally.dropped[FAILED] == count


@asynccontextmanager
async def at_work(publisher: Publisher, executor: Executor) -> AsyncIterator[tuple[dict[Stream, BusPublisher], Tally]]:
    """Yield what sends a camera's points and detections while its objects are cut out, and its tally."""
    network, tally = FakeNetwork(), Tally(FRONT)
    async with AsyncExitStack() as stack:
        theirs, ours = [await stack.enter_async_context(network.open_bus()) for _ in range(2)]
        front = await Rig(theirs, stack).camera(FRONT, Stream.POINTS, Stream.DETECTIONS)
        camera = CloudCamera(
            ours,
            FRONT,
            tally,
            worker="w1",
            executor=executor,
            limits=CloudLimits(),
            target_frame="",
            tolerance_ns=None,
            budget=MemoryBudget(),
        )
        async with asyncio.TaskGroup() as group:
            working = group.create_task(camera.run(FRONT, publisher.put))
            await until(lambda: all(each.wanted for each in front.values()), "all is wanted")
            yield front, tally
            working.cancel()


async def answers(publisher: Publisher, executor: Executor, frames: int) -> Tally:
    """Return the tally of a camera whose objects are cut out that often."""
    async with at_work(publisher, executor) as (front, tally):
        for seq in range(1, frames + 1):
            front[Stream.POINTS].put(codec.encode(registered(seq)))
            front[Stream.DETECTIONS].put(codec.encode(found(seq)))
            await until(partial(answered, tally, seq), f"{seq} were answered")
    return tally


async def test_points_that_come_at_once_are_kept_each_for_the_detections_of_its_instant() -> None:
    publisher = Publisher()
    with ThreadPoolExecutor(1) as executor:
        async with at_work(publisher, executor) as (front, _):
            for seq in (1, 2, 3):
                front[Stream.POINTS].put(codec.encode(registered(seq)))
            front[Stream.DETECTIONS].put(codec.encode(found(1)))
            await until(lambda: publisher.taken, "the first is answered")
    assert [(each.header.seq, len(each.objects)) for each in publisher.taken] == [(1, 1)]


async def test_points_that_are_more_than_can_wait_are_counted() -> None:
    publisher = Publisher()
    with ThreadPoolExecutor(1) as executor:
        async with at_work(publisher, executor) as (front, tally):
            for seq in range(1, POINTS_WAITING.depth + 4):
                front[Stream.POINTS].put(codec.encode(registered(seq)))
            front[Stream.DETECTIONS].put(codec.encode(found(POINTS_WAITING.depth + 3)))
            await until(partial(answered, tally, 1), "the last is answered")
    assert tally.load(serving=True).dropped == {TOO_MANY_POINTS: 3}


async def test_clouds_that_cannot_be_published_are_the_only_ones_that_fail(caplog: pytest.LogCaptureFixture) -> None:
    publisher = Publisher(failures=1)
    with ThreadPoolExecutor(1) as executor:
        tally = await answers(publisher, executor, 2)
    failed, made = publisher.taken
    assert (failed.header.seq, failed.objects, failed.unmeasured) == (1, [], {0: "it failed"})
    assert (made.header.seq, len(made.objects), made.unmeasured) == (2, 1, {})
    assert (tally.done, tally.load(serving=True).dropped) == (1, {FAILED: 1})
    assert "r1/front: frame 1 failed: ValueError('no message')" in caplog.text


async def test_clouds_that_cannot_be_worked_out_are_said_to_have_failed() -> None:
    publisher = Publisher()
    with ThreadPoolExecutor(1) as executor:
        executor.shutdown()
        tally = await answers(publisher, executor, 1)
    assert [each.unmeasured for each in publisher.taken] == [{0: "it failed"}]
    assert (tally.done, tally.load(serving=True).dropped) == (0, {FAILED: 1})


class Stuck(Executor):
    """Gets round to nothing."""

    def __init__(self) -> None:
        self.asked = asyncio.Event()

    def submit(self, *_: object, **__: object) -> Future[Any]:
        self.asked.set()
        return Future()


@asynccontextmanager
async def stuck_at_the_first() -> AsyncIterator[tuple[dict[Stream, BusPublisher], Tally]]:
    """See `at_work`; the first detections, number 1, are being worked out and will be for ever."""
    executor = Stuck()
    async with at_work(Publisher(), executor) as (front, tally):
        front[Stream.POINTS].put(codec.encode(registered(1)))
        front[Stream.DETECTIONS].put(codec.encode(found(1)))
        async with asyncio.timeout(60):
            await executor.asked.wait()
        yield front, tally


async def test_detections_that_nobody_has_read_when_it_ends_are_counted() -> None:
    async with stuck_at_the_first() as (front, tally):
        for seq in (2, 3):
            front[Stream.DETECTIONS].put(codec.encode(found(seq)))
    assert tally.load(serving=True).dropped == {UNWANTED: 3}


async def test_clouds_that_nobody_wants_any_more_while_they_are_worked_out_are_counted() -> None:
    async with stuck_at_the_first() as (_, tally):
        pass
    assert (tally.done, tally.load(serving=True).dropped) == (0, {UNWANTED: 1})
