import msgspec
import numpy as np
import pytest

from schemas.header import Header
from schemas.transforms import Transform
from services.geometry.errors import UnknownFrameError
from services.geometry.transforms import LITTLE, TransformTree, between
from tests.schemas.frames import header

BEFORE, AFTER = 1000, 2000


def at(stamp_ns: int, frame_id: str = "lens") -> Header:
    return msgspec.structs.replace(header(), stamp_ns=stamp_ns, frame_id=frame_id)


def driven(**metres: float) -> TransformTree:
    """Return what a robot says whose lens is that far along x of each frame after, and at its origin before."""
    made = TransformTree()
    for child, parent in (("lens", "odom"), ("odom", "map")):
        for stamp_ns, x in ((BEFORE, 0.0), (AFTER, metres.get(parent, 0.0))):
            made.add(
                Transform(
                    frame_id=parent,
                    child_frame_id=child,
                    stamp_ns=stamp_ns,
                    translation=(x, 0, 0),
                    rotation=(0, 0, 0, 1),
                ),
                static=False,
            )
    return made


def test_what_was_seen_before_is_that_much_nearer_after() -> None:
    assert between(at(AFTER), at(BEFORE), driven(odom=0.5))[:3, 3] == pytest.approx([-0.5, 0, 0])
    assert between(at(BEFORE), at(AFTER), driven(odom=0.5))[:3, 3] == pytest.approx([0.5, 0, 0])


def test_a_leap_in_the_map_is_no_movement_nor_is_a_little_one() -> None:
    for tree in (driven(map=1.0), driven(odom=0.9 * LITTLE)):
        assert between(at(AFTER), at(BEFORE), tree) == pytest.approx(np.identity(4), abs=0)


def test_at_a_stamp_that_nothing_is_known_of_nothing_moved() -> None:
    assert between(at(AFTER + 1), at(BEFORE), driven(odom=0.5)) == pytest.approx(np.identity(4), abs=0)


def test_a_joint_that_is_known_at_the_picture_and_not_at_the_points() -> None:
    """A camera that turns, and says so less often than points come: where it was is known, where it is is not."""
    tree = driven(odom=0.5)
    tree.add(
        Transform(
            frame_id="lens", child_frame_id="turned", stamp_ns=BEFORE, translation=(0, 1, 0), rotation=(0, 0, 0, 1)
        ),
        static=False,
    )
    assert between(at(BEFORE, "turned"), at(AFTER), tree)[:3, 3] == pytest.approx([0.5, -1, 0])


def test_a_frame_that_is_not_known_at_all() -> None:
    with pytest.raises(UnknownFrameError):
        between(at(AFTER), at(BEFORE, "lidar"), driven(odom=0.5))
