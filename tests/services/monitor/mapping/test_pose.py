import math

import pytest

from schemas.transforms import Transform, Transforms
from services.monitor.mapping.pose import Pose, Whereabouts
from tests.schemas.frames import header

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
