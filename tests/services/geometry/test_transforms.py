import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.transforms import Transform, Transforms
from services.geometry.errors import (
    LoopError,
    SilentError,
    TooNewError,
    TooOldError,
    UnconnectedError,
    UnknownFrameError,
)
from services.geometry.rotation import matrix_of, moved
from services.geometry.transforms import (
    BAD_ROTATION,
    JUMP_NS,
    KEEP_NS,
    MAX_FRAMES,
    MAX_SAMPLES,
    NOT_FINITE,
    OF_ITSELF,
    OUTDATED,
    SILENT_NS,
    TOO_MANY,
    TransformTree,
)
from tests.schemas.frames import header

S = 1_000_000_000


Rotation = tuple[float, float, float, float]


STRAIGHT: Rotation = (0.0, 0.0, 0.0, 1.0)


def yaw(angle: float) -> Rotation:
    return (0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))


def said(
    parent: str, child: str, x: float = 0.0, y: float = 0.0, *, at: int = 0, rotation: Rotation = STRAIGHT
) -> Transform:
    return Transform(frame_id=parent, child_frame_id=child, stamp_ns=at, translation=(x, y, 0.0), rotation=rotation)


def tree(*dynamic: Transform, static: tuple[Transform, ...] = ()) -> TransformTree:
    made = TransformTree()
    made.take(Transforms(header=header(), transforms=list(static)), static=True)
    made.take(Transforms(header=header(), transforms=list(dynamic)), static=False)
    return made


def test_a_point_goes_up_and_down_the_tree() -> None:
    made = tree(
        static=(
            said("base", "camera", 1.0),
            said("base", "arm", 0.0, 2.0, rotation=yaw(math.pi / 2)),
            said("map", "base"),
        )
    )
    assert moved(made.lookup("arm", "camera", 0), np.array([[0.0, 0, 0]])) == pytest.approx(np.array([[-2.0, -1, 0]]))
    assert made.lookup("map", "map", 0) == pytest.approx(np.identity(4))
    assert made.lookup("camera", "arm", 0) @ made.lookup("arm", "camera", 0) == pytest.approx(np.identity(4))


def test_between_two_stamps_it_is_interpolated_along_the_shorter_turn() -> None:
    turned = yaw(math.pi / 2)
    other = (0.0, 0.0, -turned[2], -turned[3])  # the same rotation
    for end in (turned, other):
        made = tree(said("odom", "base", 0.0, at=0), said("odom", "base", 4.0, at=4 * S, rotation=end))
        found = made.lookup("odom", "base", S)
        assert found == pytest.approx(matrix_of(np.array([1.0, 0, 0]), np.array(yaw(math.pi / 8))), abs=1e-9)


def test_at_the_ends_it_is_known_and_beyond_them_it_is_not() -> None:
    made = tree(said("odom", "base", 1.0, at=5 * S), said("odom", "base", 2.0, at=6 * S))
    assert made.lookup("odom", "base", 5 * S)[0, 3] == 1
    assert made.lookup("odom", "base", 6 * S)[0, 3] == 2
    with pytest.raises(TooOldError, match=r"from base to odom is known from 0\.001 s after the stamp"):
        made.lookup("odom", "base", 5 * S - 1_000_000)
    with pytest.raises(TooNewError, match=r"from base to odom is known until 0\.500 s before the stamp"):
        made.lookup("base", "odom", 6 * S + S // 2)


def test_one_that_nobody_has_said_for_long_is_not_expected_any_more() -> None:
    made = tree(said("odom", "base", 1.0, at=6 * S))
    with pytest.raises(TooNewError):
        made.lookup("odom", "base", 6 * S + SILENT_NS)
    with pytest.raises(SilentError, match=r"from base to odom is known until 1\.500 s before the stamp"):
        made.lookup("odom", "base", 7 * S + S // 2)


def test_static_ones_hold_at_any_time_and_the_newest_counts() -> None:
    made = tree(static=(said("base", "camera", 1.0, at=9 * S), said("base", "camera", 2.0, at=3 * S)))
    assert made.lookup("base", "camera", 0)[0, 3] == 2
    assert made.lookup("base", "camera", 2**62)[0, 3] == 2


def test_a_frame_that_nobody_spoke_of() -> None:
    with pytest.raises(UnknownFrameError, match="nothing is known of frame 'map'"):
        tree(static=(said("base", "camera"),)).lookup("map", "camera", 0)


def test_a_frame_is_where_it_is_itself_whatever_is_known_of_it() -> None:
    for made in (tree(), tree(said("base", "camera", at=S))):
        assert (made.lookup("camera", "/camera", 9 * S) == np.identity(4)).all()


def test_frames_that_nothing_joins() -> None:
    with pytest.raises(UnconnectedError, match="no transform leads from camera to odom"):
        tree(said("odom", "wheel"), static=(said("base", "camera"),)).lookup("odom", "camera", 0)


def test_a_loop_is_said_and_ends() -> None:
    made = tree(said("b", "a"), said("c", "b"), said("a", "c"), said("a", "d"))
    with pytest.raises(LoopError, match="frame 'a' is its own ancestor"):
        made.lookup("c", "d", 0)


def test_a_loop_further_up_harms_nobody_below() -> None:
    made = tree(said("a", "b"), said("b", "a"), said("a", "base"), static=(said("base", "camera", 1.0),))
    assert made.lookup("base", "camera", 0)[0, 3] == 1
    with pytest.raises(LoopError, match="frame 'a' is its own ancestor"):
        made.lookup("b", "camera", 0)


def test_a_new_parent_replaces_the_old_one_and_what_was_kept_of_it() -> None:
    made = tree(said("odom", "base", 1.0, at=S), said("map", "base", 2.0, at=2 * S))
    assert made.lookup("map", "base", 2 * S)[0, 3] == 2
    with pytest.raises(UnknownFrameError):
        made.lookup("odom", "base", S)


def test_slashes_before_names_mean_nothing() -> None:
    assert tree(static=(said("/base", "/camera", 3.0),)).lookup("base", "/camera", 0)[0, 3] == 3


def test_late_ones_take_their_place() -> None:
    made = tree(
        *(said("odom", "base", float(at), at=at * S) for at in (10, 12)), said("odom", "base", 50.0, at=11 * S + 1)
    )
    made.add(said("odom", "base", 11.0, at=11 * S), static=False)
    assert made.lookup("odom", "base", 11 * S)[0, 3] == 11
    assert made.lookup("odom", "base", 10 * S)[0, 3] == 10


def test_a_clock_that_jumps_back_makes_a_frame_begin_anew() -> None:
    made = tree(said("odom", "base", 1.0, at=10 * S), said("odom", "base", 2.0, at=11 * S))
    made.add(said("odom", "base", 3.0, at=11 * S - JUMP_NS - 1), static=False)
    with pytest.raises(TooNewError):
        made.lookup("odom", "base", 10 * S)
    assert made.lookup("odom", "base", 10 * S - 1)[0, 3] == 3


def test_one_stamp_from_far_ahead_does_not_stay_in_the_way() -> None:
    made = tree(said("odom", "base", 1.0, at=10 * S), said("odom", "base", 9.0, at=9_000 * S))
    made.add(said("odom", "base", 2.0, at=11 * S), static=False)
    made.add(said("odom", "base", 3.0, at=12 * S), static=False)
    assert made.lookup("odom", "base", 11 * S + S // 2)[0, 3] == 2.5


def test_frames_and_stamps_are_bounded_in_number() -> None:
    made = tree(*(said("odom", "base", at=at) for at in range(MAX_SAMPLES + 1)))
    made.lookup("odom", "base", 1)
    with pytest.raises(TooOldError):
        made.lookup("odom", "base", 0)
    for n in range(MAX_FRAMES):
        made.add(said("base", f"f{n}"), static=True)
    assert made.rejected == {TOO_MANY: 1}


def test_flushing_forgets_what_is_not_static() -> None:
    made = tree(said("odom", "base", at=S), static=(said("base", "camera", 1.0),))
    made.flush()
    assert made.lookup("base", "camera", S)[0, 3] == 1
    with pytest.raises(UnknownFrameError):
        made.lookup("odom", "camera", S)


def test_what_is_kept_is_bounded() -> None:
    made = tree(*(said("odom", "base", at=at * S // 10) for at in range(200)))
    newest = 199 * S // 10
    made.lookup("odom", "base", newest - KEEP_NS)
    with pytest.raises(TooOldError):
        made.lookup("odom", "base", newest - KEEP_NS - 1)


@pytest.mark.parametrize(
    ("transform", "reason"),
    [
        (said("a", "b", rotation=(0, 0, 0, 0)), BAD_ROTATION),
        (said("a", "b", rotation=(0, 0, 0, 1.02)), BAD_ROTATION),
        (said("a", "b", float("nan")), NOT_FINITE),
        (said("a", "b", rotation=(0, 0, 0, float("inf"))), NOT_FINITE),
        (said("a", "/a"), OF_ITSELF),
    ],
)
def test_what_means_nothing_is_counted_and_not_taken(transform: Transform, reason: str) -> None:
    made = tree(said("z", "b", 1.0), static=(said("z", "a"),))
    made.add(transform, static=False)
    assert made.rejected == {reason: 1}
    assert made.lookup("z", "b", 0)[0, 3] == 1


def test_a_rotation_that_is_nearly_of_length_1_is_made_so() -> None:
    made = tree(said("a", "b", rotation=(0, 0, 0.6 * 1.005, 0.8 * 1.005)))
    assert np.linalg.det(made.lookup("a", "b", 0)[:3, :3]) == pytest.approx(1)


numbers = st.floats(-5, 5)


quaternions = st.tuples(numbers, numbers, numbers, numbers).filter(lambda q: math.hypot(*q) > 0.1)


@given(
    steps=st.lists(st.tuples(numbers, numbers, numbers, quaternions), min_size=1, max_size=6),
    share=st.floats(0, 1),
    place=st.floats(-3, 3),
)
def test_there_and_back_is_where_it_was(
    steps: list[tuple[float, float, float, Rotation]], share: float, place: float
) -> None:
    made = TransformTree()
    for n, (x, y, z, q) in enumerate(steps):
        length = math.hypot(*q)
        rotation = (q[0] / length, q[1] / length, q[2] / length, q[3] / length)
        for at, scale in ((0, 1.0), (S, 2.0)):
            made.add(
                Transform(
                    frame_id=f"f{n}",
                    child_frame_id=f"f{n + 1}",
                    stamp_ns=at,
                    translation=(x * scale, y, z),
                    rotation=rotation if at else STRAIGHT,
                ),
                static=False,
            )
    stamp = int(share * S)
    there, back = made.lookup("f0", f"f{len(steps)}", stamp), made.lookup(f"f{len(steps)}", "f0", stamp)
    point = np.array([[place, 1.0, 2.0]])
    assert moved(back, moved(there, point)) == pytest.approx(point, abs=1e-9)
    assert there[:3, :3] @ there[:3, :3].T == pytest.approx(np.identity(3), abs=1e-9)


def test_static_transforms_that_are_said_again_change_no_frame_that_moves_meanwhile() -> None:
    """Whoever publishes one static transform more says the others again."""
    static = Transforms(header=header(), transforms=[said("base", "camera", 1.0, at=S)])
    made = TransformTree()
    made.take(static, static=True)
    for n in range(20):
        at = 2 * S + n * S // 20
        made.add(said("base", "camera", 10.0 + n, at=at), static=False)
        made.take(static, static=True)
        assert made.lookup("base", "camera", at)[0, 3] == 10.0 + n
        assert made.lookup("base", "camera", 2 * S)[0, 3] == 10.0
    assert made.rejected == {OUTDATED: 20}


@pytest.mark.parametrize("behind", [0, KEEP_NS + 2 * S, 3600 * S])
def test_static_transforms_that_are_said_again_by_another_clock_leave_what_moves_its_past(behind: int) -> None:
    made = TransformTree()
    for n in range(100):
        at = 10_000 * S + n * S // 20
        made.add(said("base", "camera", float(n), at=at - behind), static=False)
        if n % 20 == 10:
            made.add(said("base", "camera", 99.0, at=at), static=True)
        assert made.lookup("base", "camera", at - behind)[0, 3] == n
        assert made.lookup("base", "camera", 10_000 * S - behind)[0, 3] == 0
    assert made.rejected == ({OUTDATED: 5} if not behind else {})


def test_the_order_in_which_both_topics_arrive_changes_nothing() -> None:
    moving, fixed = said("base", "camera", 2.0, at=2 * S), said("base", "camera", 1.0, at=S)
    for first_static in (True, False):
        made = TransformTree()
        for static in (first_static, not first_static):
            made.add(fixed if static else moving, static=static)
        assert made.lookup("base", "camera", 2 * S)[0, 3] == 2
        with pytest.raises(TooNewError):
            made.lookup("base", "camera", 2 * S + SILENT_NS)
        with pytest.raises(SilentError):
            made.lookup("base", "camera", 2 * S + SILENT_NS + 1)


def test_a_static_transform_counts_where_its_frame_moves_no_more() -> None:
    made = tree(said("base", "camera", 2.0, at=2 * S), static=(said("map", "base"),))
    made.add(said("map", "camera", 7.0, at=2 * S + 1), static=True)
    assert made.lookup("map", "camera", 2 * S)[0, 3] == 2
    with pytest.raises(TooNewError):
        made.lookup("map", "camera", 2 * S + SILENT_NS)
    assert made.lookup("map", "camera", 2 * S + SILENT_NS + 1)[0, 3] == 7
    made.add(said("base", "camera", 3.0, at=4 * S), static=False)
    assert made.lookup("map", "camera", 4 * S)[0, 3] == 3
    assert made.lookup("map", "camera", 3 * S)[0, 3] == 2.5


def test_a_late_transform_of_a_frame_that_is_static_by_now_does_not_make_it_move() -> None:
    made = tree(said("base", "camera", 2.0, at=S), static=(said("base", "camera", 1.0, at=2 * S),))
    assert made.lookup("base", "camera", 3 * S)[0, 3] == 1


FAR = 2**63 - 1


@pytest.mark.parametrize("static_first", [True, False])
def test_one_transform_of_the_far_future_takes_no_static_frame_away(*, static_first: bool) -> None:
    made = TransformTree()
    for static in (static_first, not static_first):
        made.add(said("base", "camera", 1.0, at=S) if static else said("base", "camera", 9.0, at=FAR), static=static)
    for at in (S, 100 * S):
        assert made.lookup("base", "camera", at)[0, 3] == 1
    made.add(said("base", "camera", 2.0, at=200 * S), static=True)
    assert made.lookup("base", "camera", 201 * S)[0, 3] == 2, "a newer one counts, too"


def test_one_transform_of_the_far_future_stops_no_frame_that_moves() -> None:
    made = tree(said("odom", "base", 1.0, at=S), said("odom", "base", 9.0, at=FAR))
    made.add(said("odom", "base", 2.0, at=2 * S), static=False)
    assert made.lookup("odom", "base", 2 * S)[0, 3] == 2


def test_where_a_frame_was_before_it_is_kept_is_not_where_it_was_before_it_moved() -> None:
    made = tree(static=(said("base", "camera", 1.0, at=S),))
    for at in (10 * S, 11 * S, 12 * S + KEEP_NS):
        made.add(said("base", "camera", 5.0, at=at), static=False)
    assert made.lookup("base", "camera", 8 * S)[0, 3] == 1
    with pytest.raises(TooOldError):
        made.lookup("base", "camera", 10 * S)


def test_an_old_static_transform_that_is_said_again_replaces_no_newer_one() -> None:
    made = tree(said("base", "camera", 2.0, at=10 * S), static=(said("base", "camera", 1.0, at=S),))
    made.add(said("base", "camera", 3.0, at=20 * S), static=True)
    made.add(said("base", "camera", 1.0, at=S), static=True)
    assert made.lookup("base", "camera", 30 * S)[0, 3] == 3
    assert made.rejected == {OUTDATED: 1}
