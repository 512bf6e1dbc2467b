"""Where objects and robots were seen last."""

import msgspec
import pytest

from schemas.distances import Distances, ObjectDistance, Place
from services.monitor.liveness import POSE_LIVE_NS
from services.monitor.map.last_seen import (
    FORGET_NS,
    MAX_POSES,
    MOST,
    RENEW_NS,
    SAME_M,
    LastPoses,
    MapObject,
    SightingMap,
)
from services.monitor.map.pose import Pose
from tests.schemas.frames import header
from tests.schemas.results import known, unknown

NOW = 10_000_000_000_000


def at(x: float, y: float, *, name: str = "box", track: int | None = None, frame: str = "map") -> ObjectDistance:
    found = known(name, 2.0)
    assert found.measured is not None
    measured = msgspec.structs.replace(found.measured, places=[Place(frame_id=frame, at=(x, y, 0.5))])
    return msgspec.structs.replace(found, track=track, measured=measured)


def seen(*objects: ObjectDistance, robot: str = "r1", camera: str = "front") -> Distances:
    return Distances(header=header(robot=robot, camera=camera), objects=list(objects), model="m", worker="w")


def xy(marks: list[MapObject]) -> list[tuple[float, float]]:
    return [(mark.x, mark.y) for mark in marks]


@pytest.mark.parametrize("frame", ["map", "/map"])
def test_an_object_is_where_it_was_seen_last(frame: str) -> None:
    places = SightingMap()
    places.take(seen(at(1.0, 2.0, frame=frame)), NOW)
    assert places.marks(NOW) == [MapObject("box", 1.0, 2.0, "r1", "front", NOW)]


def test_what_is_not_known_in_the_map_is_left_out() -> None:
    places = SightingMap()
    places.take(seen(known("box", 2.0), unknown("pallet"), at(1, 1, frame="odom")), NOW)
    assert places.marks(NOW) == []


def test_a_tracked_object_moves() -> None:
    places = SightingMap()
    places.take(seen(at(1, 1, track=7)), NOW)
    places.take(seen(at(5, 5, track=7)), NOW + 1)
    assert xy(places.marks(NOW + 1)) == [(5, 5)]


@pytest.mark.parametrize(("apart_m", "count"), [(SAME_M - 0.01, 1), (SAME_M + 0.01, 2)])
def test_what_several_saw_at_one_place_is_one_object(apart_m: float, count: int) -> None:
    places = SightingMap()
    places.take(seen(at(1, 1, track=1)), NOW)
    places.take(seen(at(1 + apart_m, 1, track=2), robot="r2"), NOW + 1)
    places.take(seen(at(1, 1, name="pallet")), NOW)
    marks = [mark for mark in places.marks(NOW + 1) if mark.name == "box"]
    assert len(marks) == count
    assert marks[0].robot == "r2"
    assert [mark.robot for mark in places.marks(NOW + 1, robot="r1")] == ["r1", "r1"]


def test_an_object_that_is_followed_anew_takes_no_room_twice() -> None:
    places = SightingMap()
    for number in range(MOST + 1):
        places.take(seen(at(1, 1, track=number), at(1.1, 1, track=number + MOST)), NOW + number)
    places.take(seen(at(9, 9)), NOW + MOST + 1)
    assert xy(places.marks(NOW + MOST + 1)) == [(9, 9), (1, 1), (1.1, 1)]


def test_what_moved_to_where_something_else_was_leaves_nothing_behind() -> None:
    places = SightingMap()
    places.take(seen(at(1, 1, track=1), at(5, 5, track=2)), NOW)
    places.take(seen(at(5, 5, track=1), at(1, 1, track=2)), NOW + 1)
    places.take(seen(at(9, 9, track=1)), NOW + 2)
    assert xy(places.marks(NOW + 2)) == [(9, 9), (1, 1)]


def test_what_moves_far_takes_no_room_from_what_stands() -> None:
    places = SightingMap()
    places.take(seen(at(1, 1)), NOW)
    for number in range(MOST):
        places.take(seen(at(10 + number, 5, track=1)), NOW + 1 + number)
    assert xy(places.marks(NOW + MOST)) == [(9 + MOST, 5), (1, 1)]


def test_two_objects_of_one_image_are_two() -> None:
    places = SightingMap()
    places.take(seen(at(1, 1, track=1), at(1.1, 1, track=2)), NOW)
    assert len(places.marks(NOW)) == 2


def test_what_nobody_saw_for_long_is_forgotten_and_there_is_an_end_to_it() -> None:
    places = SightingMap()
    places.take(seen(at(1, 1)), NOW)
    assert len(places.marks(NOW + FORGET_NS)) == 1
    assert places.marks(NOW + FORGET_NS + 1) == []
    for number in range(MOST // 500 + 1):
        places.take(seen(*(at(3.0 * each, 3.0 * number, track=number * 500 + each) for each in range(500))), NOW)
    assert len(places.marks(NOW)) == MOST


def stands(x: float) -> Distances:
    """Return what a robot sees that stands x metres from the map's origin."""
    objects = [at(x + ahead, 0.0) for ahead in (1.0, 2.0)]
    made = []
    for ahead, each in zip((1.0, 2.0), objects, strict=True):
        assert each.measured is not None
        places = [Place(frame_id="base_link", at=(ahead, 0.0, 0.5)), *each.measured.places]
        made.append(msgspec.structs.replace(each, measured=msgspec.structs.replace(each.measured, places=places)))
    return seen(*made)


def test_robots_are_where_two_objects_say_they_are_looked_for_now_and_then() -> None:
    places = SightingMap()
    places.take(seen(at(1, 1)), NOW)
    assert places.poses == {}
    places.take(stands(3.0), NOW + 1)
    places.take(stands(4.0), NOW + RENEW_NS)
    assert places.poses == {"r1": Pose(3.0, 0.0, 0.0, NOW + 1)}
    places.take(stands(4.0), NOW + 1 + RENEW_NS)
    assert places.poses == {"r1": Pose(4.0, 0.0, 0.0, NOW + 1 + RENEW_NS)}


def test_where_robots_are_said_to_be_is_taken_unless_it_is_older() -> None:
    places = SightingMap()
    places.stand({"r1": Pose(1.0, 2.0, 0.5, 7)})
    places.stand({"r1": Pose(9.0, 2.0, 0.5, 7), "r2": Pose(3.0, 2.0, 0.5, 1)})
    assert places.poses == {"r1": Pose(1.0, 2.0, 0.5, 7), "r2": Pose(3.0, 2.0, 0.5, 1)}
    places.stand({"r1": Pose(9.0, 2.0, 0.5, 8)})
    assert places.poses["r1"].x == 9.0


def test_when_the_clock_is_set_back_what_is_known_is_as_old_as_before_and_what_is_newer_counts() -> None:
    places = SightingMap()
    places.take(seen(at(1, 1)), NOW)
    places.take(stands(3.0), NOW)
    places.tick(NOW + RENEW_NS)
    now_ns = NOW + RENEW_NS - FORGET_NS
    places.tick(now_ns)
    assert {now_ns - mark.seen_ns for mark in places.marks(now_ns)} == {RENEW_NS}
    assert now_ns - places.poses["r1"].at_ns == RENEW_NS
    places.take(seen(at(1.2, 1), robot="r2"), now_ns + 1)
    places.take(stands(4.0), now_ns + 1)
    assert (1, 1) not in xy(places.marks(now_ns + 1))
    assert places.poses["r1"].x == 4.0
    assert places.marks(NOW + RENEW_NS + 2) == []


NOW_NS = 10**18


def pose(x: float = 1.0, at_ns: int = NOW_NS) -> Pose:
    return Pose(x, 2.0, 0.5, at_ns)


def shown(last: LastPoses, now_ns: int, online: set[str], robot: str = "") -> list[tuple[str, float, bool]]:
    return [(each.name, each.pose.x, each.live) for each in last.robots(now_ns, online, robot=robot)]


def test_a_robot_whose_gateway_goes_stays_where_it_was_and_is_not_live() -> None:
    last = LastPoses()
    last.take({"r1": pose(), "r2": pose(3.0)}, NOW_NS)
    assert shown(last, NOW_NS, {"r1", "r2"}) == [("r1", 1.0, True), ("r2", 3.0, True)]
    last.take({"r2": pose(4.0, NOW_NS + 1)}, NOW_NS + 1)
    assert shown(last, NOW_NS + 1, {"r2"}) == [("r1", 1.0, False), ("r2", 4.0, True)]
    assert shown(last, NOW_NS + 1, {"r2"}, "r1") == [("r1", 1.0, False)]
    last.take({"r1": pose(5.0, NOW_NS + 2)}, NOW_NS + 2)
    assert shown(last, NOW_NS + 2, {"r1", "r2"}) == [("r1", 5.0, True), ("r2", 4.0, True)]


def test_a_pose_of_which_nothing_was_heard_for_a_while_is_not_of_now() -> None:
    last = LastPoses()
    last.take({"r1": pose()}, NOW_NS)
    assert shown(last, NOW_NS + POSE_LIVE_NS, {"r1"}) == [("r1", 1.0, True)]
    assert shown(last, NOW_NS + POSE_LIVE_NS + 1, {"r1"}) == [("r1", 1.0, False)]


def test_a_robot_is_forgotten_half_an_hour_after_its_pose_was_last_known() -> None:
    last = LastPoses()
    last.take({"r1": pose(), "still": pose()}, NOW_NS)
    last.take({"still": pose()}, NOW_NS + 1)
    assert [name for name, *_ in shown(last, NOW_NS + FORGET_NS, set())] == ["r1", "still"]
    assert [name for name, *_ in shown(last, NOW_NS + FORGET_NS + 1, set())] == ["still"]
    assert last.names(NOW_NS + FORGET_NS) == {"r1", "still"}
    assert last.names(NOW_NS + FORGET_NS + 1) == {"still"}


def test_a_robot_that_somebody_forgot_is_left_out_for_as_long_as_that_holds() -> None:
    gone = {"r1"}
    last = LastPoses(gone.__contains__)
    last.take({"r1": pose(), "r2": pose()}, NOW_NS)
    assert [name for name, *_ in shown(last, NOW_NS, {"r2"})] == ["r2"]
    assert last.names(NOW_NS) == {"r2"}
    gone.clear()
    assert last.names(NOW_NS) == {"r1", "r2"}


def test_so_many_are_kept_those_known_last() -> None:
    last = LastPoses()
    for number in range(MAX_POSES):
        last.take({f"r{number}": pose()}, NOW_NS)
    last.take({"r0": pose()}, NOW_NS + 1)
    last.take({"new": pose()}, NOW_NS + 2)
    assert len(last.names(NOW_NS + 2)) == MAX_POSES
    assert {"r0", "new"} <= last.names(NOW_NS + 2)
    assert "r1" not in last.names(NOW_NS + 2)


def test_a_pose_that_objects_told_is_taken_if_it_is_newer() -> None:
    last = LastPoses()
    last.take({"r1": pose(1.0, NOW_NS)}, NOW_NS + 5)
    last.take_seen({"r1": pose(2.0, NOW_NS), "r2": pose(3.0, NOW_NS - 1)})
    assert shown(last, NOW_NS, {"r1", "r2"}) == [("r1", 1.0, True), ("r2", 3.0, True)]
    last.take_seen({"r1": pose(2.0, NOW_NS + 1)})
    assert shown(last, NOW_NS + 1, {"r1"}, "r1") == [("r1", 2.0, True)]
    assert last.names(NOW_NS + FORGET_NS) == {"r1"}


def test_a_newer_pose_is_taken_though_the_clock_was_set_back() -> None:
    last = LastPoses()
    last.take_seen({"r1": pose(1.0, NOW_NS)})
    last.take_seen({"r1": pose(2.0, NOW_NS - FORGET_NS)})
    assert shown(last, NOW_NS - FORGET_NS, {"r1"}) == [("r1", 2.0, True)]
