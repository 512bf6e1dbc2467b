import asyncio
from collections.abc import Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any, NoReturn

import pytest

from bus import BusClosedError, Payload, Publisher
from bus.api import PublisherCounts
from bus.fake import FakeNetwork
from schemas import codec
from schemas.detections import Detection, Detections
from schemas.distances import Distances
from schemas.keys import Stream
from schemas.status import UNWANTED
from services.distance.camera import DistanceCamera, Viewing, work
from services.distance.camera_views import Place, ViewMaker
from services.distance.depth_in_color_view import DepthLimits, Instant, Views
from services.distance.depth_readings import Criteria
from services.distance.measuring import DepthView
from services.distance.sensor_history import DEPTH_IMAGE, SensorHistory
from services.distance.sensor_input import FAILED, DetectionCounts
from services.geometry.camera import CameraModel
from services.geometry.depth import Depth
from services.worker.stamp_joiner import Joiner
from tests.services.distance.rig import FRONT, only, robot
from tests.services.distance.scenes import depth, detections, found, mask, wall

BOX = found(mask(slice(10, 30), slice(20, 50)))


class Faltering:
    """A publisher whose first message fails."""

    wanted = True

    def __init__(self) -> None:
        self.taken: list[Distances] = []
        self._put = 0

    @property
    def counts(self) -> PublisherCounts:
        return PublisherCounts(self._put, 0)

    def put(self, payload: Payload) -> None:
        self._put += 1
        if self._put == 1:
            raise BusClosedError("the link is gone")
        self.taken.append(codec.decode(Distances, bytes(payload), codec.encoding(Distances)))


class Stuck(Executor):
    """Gets round to nothing. asked: set when it is to."""

    def __init__(self, asked: asyncio.Event) -> None:
        self._asked = asked

    def submit(self, *_: object, **__: object) -> Future[Any]:
        self._asked.set()
        return Future()


class Blind(Views):
    """Fails if it is to look at depth."""

    def view(self, of: Instant) -> NoReturn:
        raise AssertionError(of)


class Counting(Views):
    """Counts how often it looks at depth."""

    count = 0

    def view(self, of: Instant) -> tuple[Depth, CameraModel | str]:
        self.count += 1
        return super().view(of)


class Published:
    """A publisher that notes the names of streams as their messages are published."""

    def __init__(self, name: str, order: list[str], *, wanted: bool = True) -> None:
        self.wanted = wanted
        self._name = name
        self._order = order

    @property
    def counts(self) -> PublisherCounts:
        return PublisherCounts(0, 0)

    def put(self, payload: Payload) -> None:
        assert payload
        self._order.append(self._name)


class Failing(ViewMaker):
    """Makes no view."""

    def view(self, seen: Detections, depth: DepthView | str, place: Place) -> NoReturn:
        raise ValueError(seen.header.seq, depth, place)


def viewing(publisher: Publisher, maker: type[ViewMaker] = ViewMaker) -> Viewing:
    return Viewing(publisher, maker(Criteria(), "w1"), "map", period_s=0.0)


async def answers(
    publisher: Publisher,
    executor: Executor,
    frames: int,
    objects: Sequence[Detection] = BOX,
    views: type[Views] | Views = Views,
    *,
    viewing: Viewing | None = None,
    done: asyncio.Event | None = None,
) -> DetectionCounts:
    """Return the tally of a camera that is measured that often, until it is done."""
    network, tally, done = FakeNetwork(), DetectionCounts(FRONT), done or asyncio.Event()
    views = views if isinstance(views, Views) else views(DepthLimits())
    camera = DistanceCamera(tally, SensorHistory((), Joiner(DEPTH_IMAGE)), views, Criteria(), "w1", executor, viewing)
    async with (
        network.open_bus() as theirs,
        network.open_bus() as ours,
        robot(theirs) as front,
        asyncio.TaskGroup() as group,
    ):
        working = group.create_task(work(ours, camera, publisher, done.set))
        await front.until_wanted()
        for seq in range(frames):
            front.send(Stream.DEPTH, depth(wall(2.0), seq))
            front.send(Stream.DETECTIONS, detections(list(objects), seq))
            async with asyncio.timeout(60):
                await done.wait()
            done.clear()
        working.cancel()
    return tally


async def test_an_answer_that_cannot_be_published_is_the_only_one_that_fails(caplog: pytest.LogCaptureFixture) -> None:
    publisher = Faltering()
    with ThreadPoolExecutor(1) as executor:
        tally = await answers(publisher, executor, 3)
    assert [(seen.header.seq, only(seen)) for seen in publisher.taken] == [(1, (2.0, "")), (2, (2.0, ""))]
    assert (tally.done, tally.load(serving=True).dropped) == (2, {FAILED: 1})
    assert "r1/front: frame 0 failed: BusClosedError('the link is gone')" in caplog.text


async def test_an_answer_that_cannot_be_worked_out_is_counted() -> None:
    publisher = Faltering()
    with ThreadPoolExecutor(1) as executor:
        executor.shutdown()
        tally = await answers(publisher, executor, 2)
    assert (tally.done, tally.load(serving=True).dropped) == (0, {FAILED: 2})


async def test_an_image_without_objects_needs_no_look_at_depth() -> None:
    publisher = Faltering()
    with ThreadPoolExecutor(1) as executor:
        tally = await answers(publisher, executor, 2, objects=(), views=Blind)
    assert [seen.objects for seen in publisher.taken] == [[]]
    assert tally.done == 1


async def test_distances_come_before_the_view_and_depth_is_read_once_for_both() -> None:
    order: list[str] = []
    views = Counting(DepthLimits())
    with ThreadPoolExecutor(1) as executor:
        view = viewing(Published("view", order))
        tally = await answers(Published("distances", order), executor, 2, views=views, viewing=view)
    assert order == ["distances", "view"] * 2
    assert views.count == 2
    assert (tally.done, tally.load(serving=True).dropped) == (2, {})


async def test_a_view_that_fails_costs_no_distances(caplog: pytest.LogCaptureFixture) -> None:
    order: list[str] = []
    with ThreadPoolExecutor(1) as executor:
        view = viewing(Published("view", order), Failing)
        tally = await answers(Published("distances", order), executor, 2, viewing=view)
    assert order == ["distances"] * 2
    assert (tally.done, tally.load(serving=True).dropped) == (2, {f"view: {FAILED}": 2})
    assert "r1/front: the view of frame 0 failed: ValueError" in caplog.text


async def test_a_view_that_fails_where_nobody_wants_distances_fails_the_image() -> None:
    order: list[str] = []
    with ThreadPoolExecutor(1) as executor:
        view = viewing(Published("view", order), Failing)
        tally = await answers(Published("distances", order, wanted=False), executor, 2, viewing=view)
    assert order == []
    assert (tally.done, tally.load(serving=True).dropped) == (0, {FAILED: 2})


async def test_detections_that_nobody_has_read_when_it_ends_are_counted() -> None:
    asked, tally = asyncio.Event(), DetectionCounts(FRONT)
    camera = DistanceCamera(
        tally, SensorHistory((), Joiner(DEPTH_IMAGE)), Views(DepthLimits()), Criteria(), "w1", Stuck(asked)
    )
    network = FakeNetwork()
    async with network.open_bus() as theirs, network.open_bus() as ours, robot(theirs) as front:
        working = asyncio.create_task(work(ours, camera, Faltering(), lambda: None))
        await front.until_wanted()
        for seq in range(3):
            front.send(Stream.DEPTH, depth(wall(2.0), seq))
            front.send(Stream.DETECTIONS, detections(list(BOX), seq))
            async with asyncio.timeout(60):
                await asked.wait()  # the first is being worked out from now on
        working.cancel()
        await asyncio.wait([working])
    assert tally.load(serving=True).dropped == {UNWANTED: 3}


async def test_an_answer_that_nobody_wants_any_more_while_it_is_worked_out_is_counted() -> None:
    asked = asyncio.Event()
    tally = await answers(Faltering(), Stuck(asked), 1, done=asked)
    assert (tally.done, tally.load(serving=True).dropped) == (0, {UNWANTED: 1})
