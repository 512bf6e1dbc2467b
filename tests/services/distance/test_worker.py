import asyncio
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass

import msgspec
import numpy as np
import pytest

from bus import QUEUE, Bus, Subscription
from bus.clocks import clock_id
from bus.fake import FakeNetwork
from bus.reporting import VERSION
from schemas import consumer_keys, worker_keys
from schemas.consumer_keys import Wanted
from schemas.distances import CameraView, Distances
from schemas.keys import TF, TF_STATIC, CameraKey, RobotStreamKey, Stream, StreamKey
from schemas.status import WorkerStatus
from services.distance.camera import WAITED
from services.distance.sensor_input import DUPLICATE
from services.worker.stamp_joiner import FLUSHED
from tests.services.distance.rig import FRONT, Robot, load, only, robot, working
from tests.services.distance.scenes import (
    FRAME,
    calibration,
    depth,
    detections,
    found,
    head,
    mask,
    stamp_of,
    transforms,
    wall,
)
from tests.waiting import receive, until

HOUR_NS = 3_600 * 10**9
BOX = found(mask(slice(10, 30), slice(20, 50)))


@dataclass
class Rig:
    bus: Bus
    robot: Robot

    @asynccontextmanager
    async def wanted(self) -> AsyncIterator[Subscription]:
        async with self.bus.subscribe(FRONT.stream(Stream.DISTANCES), QUEUE(9)) as distances:
            await self.robot.until_wanted()
            yield distances

    def frame(self, seq: int, z: float = 2.0, *, stamp_ns: int | None = None) -> None:
        self.robot.send(Stream.DEPTH, depth(wall(z), seq, stamp_ns=stamp_ns))
        self.robot.send(Stream.DETECTIONS, detections(BOX, seq, stamp_ns=stamp_ns))


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    network = FakeNetwork()
    with ThreadPoolExecutor(1) as executor:
        async with (
            network.open_bus() as theirs,
            network.open_bus("rack1") as ours,
            robot(theirs) as front,
            working(ours, executor),
        ):
            front.send(Stream.INFO, calibration())
            front.send(TF_STATIC, transforms(("base_link", FRAME, 0.5)))
            yield Rig(theirs, front)


async def test_it_says_its_version(rig: Rig) -> None:
    async with rig.bus.subscribe(worker_keys.worker_status("distance", "w1"), QUEUE(9)) as statuses:
        assert (await receive(statuses, WorkerStatus)).version == VERSION


async def test_nobody_asks_so_nothing_is_subscribed(rig: Rig) -> None:
    await load(rig.bus, lambda of: of.serving)
    await rig.robot.until_wanted(wanted=False)
    async with rig.wanted():
        pass
    await rig.robot.until_wanted(wanted=False)


async def test_a_listener_gets_distances_and_places(rig: Rig) -> None:
    async with rig.wanted() as distances:
        rig.robot.send(TF, transforms(("map", "base_link", 1.0), stamp_ns=stamp_of(4)))
        rig.robot.send(TF, transforms(("map", "base_link", 2.0), stamp_ns=stamp_of(6)))
        rig.frame(5)
        seen = await receive(distances, Distances)
    assert (seen.header, seen.model, seen.worker) == (detections(BOX, 5).header, "m", "w1")
    assert set(seen.spans) == {"model", WAITED, "distance"}
    assert only(seen) == (2.0, "")
    measured = seen.objects[0].measured
    assert measured is not None
    camera, base, of_map = (place.at for place in measured.places)
    assert camera is not None
    assert base == pytest.approx((camera[0] + 0.5, *camera[1:]))
    assert of_map == pytest.approx((camera[0] + 2.0, *camera[1:]))


async def test_it_says_how_long_it_was_at_work(rig: Rig) -> None:
    async with rig.bus.subscribe(worker_keys.worker_status("distance", "w1"), QUEUE(9)) as statuses:
        assert (await receive(statuses, WorkerStatus)).busy_s == 0
        async with rig.wanted() as distances:
            rig.frame(5)
            await receive(distances, Distances)
        while not (await receive(statuses, WorkerStatus)).busy_s:
            pass


async def test_who_wants_views_alone_gets_them_and_not_more_than_are_due(rig: Rig) -> None:
    async with rig.bus.subscribe(FRONT.stream(Stream.VIEW), QUEUE(99)) as views:
        await rig.robot.until_wanted()
        rig.robot.send(TF, transforms(("map", "base_link", 1.0), stamp_ns=stamp_of(-9)))
        rig.robot.send(TF, transforms(("map", "base_link", 2.0), stamp_ns=stamp_of(99)))
        rig.frame(5)
        seen = await receive(views, CameraView)
        for seq in range(6, 12):
            rig.frame(seq)
        await load(rig.bus, lambda of: sum(of.dropped.values()) >= 3)
        assert views.counts.received <= 3
    assert (seen.header, seen.frame_id, seen.worker) == (detections(BOX, 5).header, "map", "w1")
    assert seen.position is not None
    assert seen.speed == pytest.approx(1e9 / (stamp_of(99) - stamp_of(-9)), rel=0.01)
    assert [each.name for each in seen.objects] == ["box"]


async def test_where_a_robot_is_is_not_guessed_from_where_it_was_when_somebody_last_asked(rig: Rig) -> None:
    rig.robot.send(TF, transforms(("map", "base_link", 1.0), stamp_ns=stamp_of(-100)))
    async with rig.wanted() as distances:
        rig.robot.send(TF, transforms(("map", "base_link", 2.0), stamp_ns=stamp_of(6)))
        rig.frame(5)
        seen = await receive(distances, Distances)
    measured = seen.objects[0].measured
    assert measured is not None
    assert [bool(place.at) for place in measured.places] == [True, True, False]
    assert measured.places[2].unknown == "the transform from base_link to map is known from 0.033 s after the stamp"


async def test_the_gateway_is_told_where_its_depth_and_transforms_go(rig: Rig) -> None:
    async with rig.bus.watch(consumer_keys.every_wanted("r1")) as watch, rig.wanted():
        async with asyncio.timeout(60):
            depth, moving = sorted([consumer_keys.parse_wanted((await anext(watch)).key) for _ in range(2)], key=str)
    assert depth == Wanted(StreamKey(FRONT, Stream.DEPTH), clock_id(), "w1")
    assert (moving.key, moving.clock_id) == (RobotStreamKey("r1", TF), clock_id())
    assert moving.consumer.startswith("rack1-")


async def test_detections_wait_for_the_depth_of_their_instant(rig: Rig) -> None:
    async with rig.wanted() as distances:
        rig.robot.send(Stream.DEPTH, depth(wall(1.0), 1))
        rig.robot.send(Stream.DETECTIONS, detections(BOX, 2))
        await asyncio.sleep(0.02)
        rig.robot.send(Stream.DEPTH, depth(wall(3.0), 2))
        assert only(await receive(distances, Distances)) == (3.0, "")


async def test_each_way_in_which_nothing_is_known_is_said(rig: Rig) -> None:
    async with rig.wanted() as distances:
        rig.robot.send(Stream.DETECTIONS, detections(BOX, 1))
        assert only(await receive(distances, Distances)) == (None, "no depth image arrived")
        rig.frame(5)
        await receive(distances, Distances)
        rig.robot.send(Stream.DETECTIONS, detections(BOX, 6, stamp_ns=stamp_of(2)))
        _, reason = only(await receive(distances, Distances))
        assert reason == "no depth image of its instant: the nearest is 0.099 s after it"
        rig.robot.send(Stream.DETECTIONS, detections(BOX, 7, stamp_ns=stamp_of(900)))
        _, reason = only(await receive(distances, Distances))
        assert reason == "no depth image of its instant: the nearest is 29.535 s before it"
        odd = msgspec.structs.replace(depth(wall(2.0), 8), encoding="mono16")
        rig.robot.send(Stream.DEPTH, odd)
        rig.robot.send(Stream.DETECTIONS, detections(BOX, 8))
        assert only(await receive(distances, Distances)) == (None, "an image in mono16, which is no depth")
        rig.robot.send(Stream.DEPTH_INFO, calibration(lens=("odd", [0.1])))
        rig.frame(9)
        assert "unknown distortion model 'odd'" in only(await receive(distances, Distances))[1]


async def test_stamps_that_are_not_there_join_nothing(rig: Rig) -> None:
    async with rig.wanted() as distances:
        rig.robot.send(Stream.DEPTH, depth(wall(2.0), 1, stamp_ns=0))
        rig.robot.send(Stream.DETECTIONS, detections(BOX, 1, stamp_ns=0))
        assert only(await receive(distances, Distances)) == (None, "the image has no stamp")
        tally = await load(rig.bus, lambda of: sum(of.dropped.values()) == 2)
    assert tally.dropped == {"depth image: without a stamp": 1, "no depth image of the same instant": 1}
    assert tally.inferred == 0


async def test_an_empty_view_is_news_too(rig: Rig) -> None:
    async with rig.wanted() as distances:
        rig.robot.send(Stream.DEPTH, depth(wall(), 1))
        rig.robot.send(Stream.DETECTIONS, detections([], 1))
        assert (await receive(distances, Distances)).objects == []


async def test_a_loop_of_transforms_is_a_reason_and_distances_go_on(rig: Rig) -> None:
    async with rig.wanted() as distances:
        rig.robot.send(TF, transforms(("map", "odom", 0.0), ("odom", "map", 0.0), ("odom", "base_link", 0.0)))
        rig.frame(1)
        seen = await receive(distances, Distances)
    measured = seen.objects[0].measured
    assert measured is not None
    assert measured.axial_m == 2
    assert [place.unknown for place in measured.places] == ["", "", "frame 'odom' is its own ancestor"]


async def test_a_camera_that_waits_for_its_robots_map_holds_up_no_other(rig: Rig) -> None:
    other = CameraKey("r2", "front")
    async with robot(rig.bus, other) as of_r2, rig.bus.subscribe("fleet/*/*/distances", QUEUE(9)) as distances:
        await rig.robot.until_wanted()
        await of_r2.until_wanted()
        rig.robot.send(TF, transforms(("map", "base_link", 1.0), stamp_ns=stamp_of(4)))
        rig.frame(5)
        await asyncio.sleep(0.02)
        of_r2.send(Stream.DEPTH, msgspec.structs.replace(depth(wall(3.0), 5), header=head(5, robot="r2")))
        of_r2.send(Stream.DETECTIONS, msgspec.structs.replace(detections(BOX, 5), header=head(5, robot="r2")))
        first, second = [await receive(distances, Distances) for _ in range(2)]
    assert (first.header.robot, only(first)) == ("r2", (3.0, ""))
    assert (second.header.robot, only(second)) == ("r1", (2.0, ""))
    measured = second.objects[0].measured
    assert measured is not None
    assert measured.places[2].unknown == "the transform from base_link to map is known until 0.033 s before the stamp"


async def test_a_clock_that_jumps_back_starts_over(rig: Rig) -> None:
    async with rig.wanted() as distances:
        for seq, (instant, z) in enumerate(((100, 2.0), (101, 2.0), (3, 4.0))):
            rig.frame(seq, z, stamp_ns=stamp_of(instant))
            assert only(await receive(distances, Distances)) == (z, "")
    tally = await load(rig.bus, lambda of: of.inferred == 3)
    assert tally.dropped == {}


async def test_bad_messages_are_counted_and_harm_nobody(rig: Rig) -> None:
    stranger = head(1, robot="r9")
    async with rig.wanted() as distances:
        for stream in (Stream.DETECTIONS, Stream.DEPTH, Stream.INFO, TF):
            rig.robot.send(stream, b"garbage")
        await asyncio.sleep(0.02)
        rig.robot.send(Stream.DETECTIONS, msgspec.structs.replace(detections(BOX, 1), header=stranger))
        rig.robot.send(Stream.DEPTH, msgspec.structs.replace(depth(wall(), 1), header=stranger))
        turned = transforms(("map", "base_link", float("nan")))
        rig.robot.send(TF, turned)
        await asyncio.sleep(0.02)
        rig.frame(2)
        assert only(await receive(distances, Distances)) == (2.0, "")
        tally = await load(rig.bus, lambda of: of.inferred == 1)
    assert tally.dropped == {
        "malformed detections": 2,
        "malformed depth image": 2,
        "malformed camera info": 1,
        "malformed transforms": 1,
        "transforms: not finite": 1,
    }


async def test_the_same_detections_of_two_workers_are_measured_once(rig: Rig) -> None:
    async with rig.wanted() as distances:
        rig.frame(1)
        assert (await receive(distances, Distances)).header.seq == 1
        rig.frame(1)
        await asyncio.sleep(0.02)
        rig.frame(2)
        assert (await receive(distances, Distances)).header.seq == 2
        tally = await load(rig.bus, lambda of: of.inferred == 2)
    assert tally.dropped[DUPLICATE] == 1


async def test_detections_of_a_worker_that_is_behind_another_are_not_measured(rig: Rig) -> None:
    async with rig.wanted() as distances:
        for seq in (2, 1):
            rig.frame(seq)
            await asyncio.sleep(0.02)
        rig.frame(3)
        assert [(await receive(distances, Distances)).header.seq for _ in range(2)] == [2, 3]
        tally = await load(rig.bus, lambda of: of.inferred == 2)
    assert tally.dropped[DUPLICATE] == 1


async def test_depth_that_no_detections_came_for_is_counted(rig: Rig) -> None:
    async with rig.wanted() as distances:
        for seq in (0, 1, 100):
            rig.robot.send(Stream.DEPTH, depth(wall(), seq))
            await asyncio.sleep(0.01)
        rig.robot.send(Stream.DETECTIONS, detections(BOX, 100))
        await receive(distances, Distances)
        tally = await load(rig.bus, lambda of: of.inferred == 1)
    assert tally.dropped == {"depth image: nothing of its instant was asked for": 2}


async def test_all_cameras_depth_together_has_one_bound_and_what_it_costs_is_counted() -> None:
    network = FakeNetwork()
    large = np.full((1024, 1280), 2.0, np.float32)  # 2.5 MiB a depth image
    with ThreadPoolExecutor(1) as executor:
        async with (
            network.open_bus() as theirs,
            network.open_bus() as ours,
            robot(theirs) as modest,
            robot(theirs, CameraKey("r2", "front")) as greedy,
            working(ours, executor, memory_mib=16),
            theirs.subscribe("fleet/*/*/distances", QUEUE(9)),
        ):
            await modest.until_wanted()
            await greedy.until_wanted()
            for seq in range(2):
                modest.send(Stream.DEPTH, depth(large, seq))
                await asyncio.sleep(0.01)
            for seq in range(7):
                sent = depth(large, seq)
                greedy.send(Stream.DEPTH, msgspec.structs.replace(sent, header=head(seq, robot="r2")))
                await asyncio.sleep(0.01)
            tally = await load(theirs, lambda of: of.robot == "r2" and sum(of.dropped.values()) == 3)
            assert tally.dropped == {"depth image: no room for more": 3}
            tally = await load(theirs, lambda of: of.robot == "r1")
            assert tally.dropped == {}


async def test_depth_from_the_future_is_joined_with_nothing_and_does_not_stay_in_the_way(rig: Rig) -> None:
    async with rig.wanted() as distances:
        rig.robot.send(Stream.DEPTH, depth(wall(9.0), 1, stamp_ns=stamp_of(1) + HOUR_NS))
        rig.robot.send(Stream.DETECTIONS, detections(BOX, 1))
        axial_m, reason = only(await receive(distances, Distances))
        assert axial_m is None
        assert reason == "no depth image of its instant: the nearest is 3600.000 s after it"
        for seq in (2, 3):
            rig.frame(seq)
            assert only(await receive(distances, Distances)) == (2.0, "")
        tally = await load(rig.bus, lambda of: of.inferred == 2)
    assert tally.dropped == {f"depth image: {FLUSHED}": 1, "no depth image of the same instant": 1}


async def test_only_the_robots_it_is_told_are_served() -> None:
    network = FakeNetwork()
    with ThreadPoolExecutor(1) as executor:
        async with (
            network.open_bus() as theirs,
            network.open_bus() as ours,
            robot(theirs) as of_r1,
            robot(theirs, CameraKey("r2", "front")) as of_r2,
            working(ours, executor, robots=["r2"]),
            theirs.subscribe("fleet/*/*/distances", QUEUE(9)),
        ):
            await of_r2.until_wanted()
            await until(lambda: not of_r1.wanted(Stream.DEPTH), "the other robot is left alone")
