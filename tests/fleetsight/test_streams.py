"""Streams over real sessions: what is kept and what is dropped, and that nothing is left behind."""

import asyncio
from contextlib import AsyncExitStack, aclosing
from functools import partial

import msgspec
import pytest

import fleetsight
from bus import BusSettings, QoS, Queue, open_bus
from fleetsight import Fleet, StreamCounts
from schemas import codec
from schemas.detections import ClassCount, ClassList, class_list
from schemas.keys import CameraKey, Stream
from tests.contract.conftest import free_endpoint
from tests.fleetsight.stand_in import ALERT, CLOUDS, FAR, FOUND, FRONT, StandIn
from tests.schemas.frames import header
from tests.waiting import next_of, until


def seen(count: int, robot: str = "r1", camera: str = "front") -> bytes:
    of = header(robot=robot, camera=camera, seq=count)
    return codec.encode(ClassList(header=of, classes=[ClassCount("box", count, 0.5)], model="m", worker="w"))


async def test_what_was_last_known_comes_first(fleet: Fleet) -> None:
    assert await next_of(aiter(fleet.class_lists())) == class_list(FOUND)
    assert await next_of(aiter(fleet.detections(robot="r*"))) == FOUND
    assert await next_of(aiter(fleet.distances(camera="front"))) == FAR
    assert await next_of(aiter(fleet.alerts("r1"))) == ALERT


async def test_points_come_as_they_are_made(fleet: Fleet) -> None:
    clouds = await next_of(aiter(fleet.objects()))
    assert clouds == CLOUDS
    assert clouds.objects[0].count == 2


async def test_only_the_robots_and_cameras_that_are_meant_come(there: StandIn, fleet: Fleet) -> None:
    encoding = codec.encoding(ClassList)
    async with aclosing(aiter(fleet.class_lists("s*", "*r"))) as lists:
        coming = asyncio.create_task(next_of(lists))
        for robot, camera in (("r2", "rear"), ("s1", "front"), ("s1", "rear")):
            key = CameraKey(robot, camera).stream(Stream.CLASSES)
            async with there.bus.publisher(key, QoS.RESULT, encoding=encoding) as publisher:
                publisher.put(seen(1, robot, camera))
                if camera == "rear" and robot == "s1":
                    assert (await coming).header.camera == "rear"
                else:
                    await asyncio.sleep(0.1)
                    assert not publisher.wanted


async def test_the_newest_of_each_camera_wins_and_what_it_replaced_is_counted(there: StandIn, fleet: Fleet) -> None:
    lists = fleet.class_lists("r1")
    async with aclosing(aiter(lists)) as coming:
        await next_of(coming)
        for count in range(1, 6):
            there.publishers[FRONT.stream(Stream.CLASSES)].put(seen(count))
        await until(lambda: lists.counts.received == 6)
        assert (await next_of(coming)).classes[0].count == 5
        assert lists.counts == StreamCounts(received=6, dropped=4)
    assert lists.counts == StreamCounts(received=6, dropped=4)


async def test_a_queue_keeps_the_newest_in_order(there: StandIn, fleet: Fleet) -> None:
    lists = fleet.class_lists("r1", keep=fleetsight.QUEUE(3))
    async with aclosing(aiter(lists)) as coming:
        await next_of(coming)
        for count in range(1, 6):
            there.publishers[FRONT.stream(Stream.CLASSES)].put(seen(count))
        await until(lambda: lists.counts.received == 6)
        assert [(await next_of(coming)).classes[0].count for _ in range(3)] == [3, 4, 5]
        assert lists.counts.dropped == 2


async def test_what_the_contract_does_not_allow_is_left_out_and_counted(there: StandIn, fleet: Fleet) -> None:
    publisher = there.publishers[FRONT.stream(Stream.CLASSES)]
    lists = fleet.class_lists(keep=fleetsight.QUEUE(9))
    async with aclosing(aiter(lists)) as coming:
        await next_of(coming)
        publisher.put(b"no message")
        publisher.put(seen(1, camera="another"))
        publisher.put(seen(2))
        assert (await next_of(coming)).classes[0].count == 2
    assert lists.counts.invalid == 2


async def test_an_alert_for_another_robot_than_its_key_says_is_left_out(there: StandIn, fleet: Fleet) -> None:
    alerts = fleet.alerts()
    async with aclosing(aiter(alerts)) as coming:
        await next_of(coming)
        publisher = there.publishers["fleet/r1/alerts"]
        publisher.put(codec.encode(msgspec.structs.replace(ALERT, robot="r2")))
        publisher.put(codec.encode(msgspec.structs.replace(ALERT, id="a2")))
        assert (await next_of(coming)).id == "a2"
    assert alerts.counts.invalid == 1


async def test_nobody_is_made_to_work_before_or_after_the_iteration(there: StandIn, fleet: Fleet) -> None:
    lists, before = fleet.class_lists(), asyncio.all_tasks()
    assert not there.wanted(Stream.CLASSES)
    async for _ in lists:
        await until(lambda: there.wanted(Stream.CLASSES))
        break
    await until(lambda: not there.wanted(Stream.CLASSES))
    await until(lambda: asyncio.all_tasks() <= before)


async def test_a_task_that_is_cancelled_leaves_no_subscriber(there: StandIn, fleet: Fleet) -> None:
    async def listen() -> None:
        async for _ in fleet.images("r1", "front"):
            pass

    listening = asyncio.create_task(listen())
    await until(lambda: there.wanted(Stream.COLOR))
    listening.cancel()
    await asyncio.wait([listening])
    assert listening.cancelled()
    await until(lambda: not there.wanted(Stream.COLOR))


@pytest.mark.parametrize("times", range(5))
async def test_leaving_the_fleet_leaves_no_task_of_an_iteration_behind(there: StandIn, times: int) -> None:
    before = asyncio.all_tasks()
    async with fleetsight.connect(there.endpoint) as fleet:
        for _ in range(times):
            async for _ in fleet.class_lists():
                break
            async for _ in fleet.robots():
                break
        kept = aiter(fleet.class_lists())
        await next_of(kept)
    assert asyncio.all_tasks() == before
    with pytest.raises(StopAsyncIteration):
        await anext(kept)
    await until(lambda: not there.wanted(Stream.CLASSES))


async def test_a_task_that_is_at_work_on_a_message_ends_with_the_fleet(there: StandIn) -> None:
    may_go_on, taken = asyncio.Event(), list[object]()

    async def work(fleet: Fleet) -> None:
        async for each in fleet.class_lists():
            taken.append(each)
            await may_go_on.wait()

    async with fleetsight.connect(there.endpoint) as fleet:
        working = asyncio.create_task(work(fleet))
        await until(lambda: taken)
    may_go_on.set()
    await working
    assert len(taken) == 1


async def test_leaving_the_fleet_ends_what_still_iterates(there: StandIn) -> None:
    ended = []

    async def listen(fleet: Fleet) -> None:
        async for _ in fleet.detections():
            pass
        ended.append(fleet)

    async with fleetsight.connect(there.endpoint) as fleet:
        listening = asyncio.create_task(listen(fleet))
        await until(lambda: there.wanted(Stream.DETECTIONS))
    await listening
    assert ended == [fleet]
    await until(lambda: not there.wanted(Stream.DETECTIONS))
    with pytest.raises(
        fleetsight.ClosedError, match=r"^classes: the fleet was left before; iterate within `async with`"
    ):
        await next_of(aiter(fleet.class_lists()))
    with pytest.raises(fleetsight.ClosedError, match=r"^images of r1/front: "):
        await next_of(aiter(fleet.images("r1", "front")))


async def test_a_stream_can_be_iterated_over_again_and_counts_all(fleet: Fleet) -> None:
    lists = fleet.class_lists()
    async for _ in lists:
        async for _ in lists:
            break
        break
    assert lists.counts.received == 2
    async for _ in lists:
        break
    assert lists.counts.received == 3


async def test_a_link_that_breaks_is_made_again_and_the_iteration_goes_on() -> None:
    endpoint, key = free_endpoint(), FRONT.stream(Stream.CLASSES)
    router = BusSettings(mode="router", listen=[endpoint], lease_s=1)
    async with AsyncExitStack() as stack:
        async with open_bus(router):
            joining = fleetsight.connect(settings=BusSettings(connect=[endpoint], lease_s=1))
            fleet = await stack.enter_async_context(joining)
            coming = asyncio.create_task(next_of(aiter(fleet.class_lists())))
        await until(lambda: fleet.problem)
        assert not coming.done()
        async with (
            open_bus(router) as again,
            again.publisher(key, QoS.RESULT, encoding=codec.encoding(ClassList)) as publisher,
        ):
            publisher.put(seen(7))
            assert (await coming).classes[0].count == 7
            assert fleet.problem == ""


@pytest.mark.parametrize("depth", [0, -1, 2.5, None, "100"])
def test_a_queue_that_keeps_nothing_is_refused(depth: int) -> None:
    with pytest.raises(fleetsight.SettingsError, match=f"^queue depth {depth!r}: use a whole number"):
        fleetsight.QUEUE(depth)


@pytest.mark.parametrize("keep", [3, None, fleetsight.QUEUE])
async def test_what_cannot_be_kept_is_refused_at_once(fleet: Fleet, keep: Queue) -> None:
    for listen in (fleet.class_lists, fleet.objects, fleet.alerts, partial(fleet.images, "r1", "front")):
        with pytest.raises(fleetsight.SettingsError, match=r"^keep .*; use LATEST or QUEUE"):
            listen(keep=keep)
