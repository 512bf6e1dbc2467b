import msgspec
import pytest

from schemas.distances import Distances, ObjectDistance, Place
from services.monitor.map.last_seen import FORGET_NS, MOST, RENEW_NS, SAME_M, MapObject, SightingMap
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
