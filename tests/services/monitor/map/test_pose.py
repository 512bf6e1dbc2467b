import math

import msgspec
import pytest

from schemas.distances import Distances, ObjectDistance, Place
from schemas.transforms import Transform, Transforms
from services.monitor.map.pose import APART_M, Pose, Whereabouts, pose_of
from tests.schemas.frames import header
from tests.schemas.results import known, unknown

STILL = (0.0, 0.0, 0.0, 1.0)
LEFT = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))


def transform(
    parent: str,
    child: str,
    stamp_ns: int,
    x: float = 0.0,
    rotation: tuple[float, float, float, float] = STILL,
) -> Transform:
    return Transform(
        frame_id=parent, child_frame_id=child, stamp_ns=stamp_ns, translation=(x, 1.0, 0.0), rotation=rotation
    )


def message(*transforms: Transform) -> Transforms:
    return Transforms(header=header(camera=""), transforms=list(transforms))


def test_the_pose_is_of_the_newest_stamp_that_is_known_all_the_way() -> None:
    where = Whereabouts()
    where.take(message(transform("map", "odom", 10), transform("odom", "base_link", 10, 1.0, LEFT)), 100, static=False)
    where.take(message(transform("odom", "base_link", 20, 9.0)), 200, static=False)
    assert where.pose() == Pose(1.0, 2.0, pytest.approx(math.pi / 2), 200)  # type: ignore[arg-type]
    where.take(message(transform("map", "odom", 20)), 300, static=False)
    assert where.pose() == Pose(9.0, 2.0, 0.0, 300)


def test_a_robot_that_never_moves_is_somewhere_too() -> None:
    where = Whereabouts()
    where.take(message(transform("map", "base_footprint", 0, 3.0)), 100, static=True)
    assert where.pose() == Pose(3.0, 1.0, 0.0, 100)


def test_what_is_missing_is_said() -> None:
    where = Whereabouts()
    assert where.pose() == "its transforms have not arrived"
    where.take(message(transform("odom", "base_link", 10)), 100, static=False)
    assert "map" in str(where.pose())


def at(base: tuple[float, float], in_map: tuple[float, float] | None, *, frame: str = "base_link") -> ObjectDistance:
    found = known("box", 2.0)
    assert found.measured is not None
    there = (
        Place(frame_id="map", unknown="no transform") if in_map is None else Place(frame_id="map", at=(*in_map, 0.4))
    )
    places = [Place(frame_id="camera", at=(0, 0, 1)), Place(frame_id=frame, at=(*base, 0.5)), there]
    return msgspec.structs.replace(found, measured=msgspec.structs.replace(found.measured, places=places))


def saw(*objects: ObjectDistance) -> Distances:
    return Distances(header=header(), objects=list(objects), model="m", worker="w")


def test_two_objects_say_where_the_robot_is_and_how_it_is_turned() -> None:
    for yaw in (0.0, 1.0, math.pi / 2, -3.0):

        def moved(x: float, y: float, yaw: float = yaw) -> tuple[float, float]:
            return 5 + math.cos(yaw) * x - math.sin(yaw) * y, -2 + math.sin(yaw) * x + math.cos(yaw) * y

        pose = pose_of(saw(at((2, 1), moved(2, 1)), unknown("pallet"), at((3, -1), moved(3, -1))), 7)
        assert pose is not None
        assert [pose.x, pose.y, pose.yaw, pose.at_ns] == pytest.approx([5, -2, yaw, 7])


def test_objects_that_are_too_near_to_each_other_or_not_in_the_map_do_not() -> None:
    near = at((2, 0), (2, 0))
    assert pose_of(saw(), 7) is None
    assert pose_of(saw(near), 7) is None
    assert pose_of(saw(near, at((2 + APART_M - 0.01, 0), (2 + APART_M - 0.01, 0))), 7) is None
    assert pose_of(saw(near, at((2 + APART_M + 0.01, 0), (2 + APART_M + 0.01, 0))), 7) == Pose(0, 0, 0, 7)
    assert pose_of(saw(near, at((4, 0), None)), 7) is None
    assert pose_of(saw(near, at((4, 0), (4, 0), frame="odom")), 7) is None
    assert pose_of(saw(near, at((4, 0), (4, 0), frame="base_footprint")), 7) == Pose(0, 0, 0, 7)
