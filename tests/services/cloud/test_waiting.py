import msgspec
import pytest

from bus.sharing.work_counts import Tally
from schemas.detections import Detections
from schemas.header import Header
from schemas.keys import CameraKey
from schemas.points import PointCloud
from schemas.transforms import Transform, Transforms
from services.cloud.waiting import DUPLICATE, MAX_WAITING, NO_STAMP, POINTS_WAIT_S, REPLACED, UNSTAMPED, CloudJoiner
from services.geometry.errors import TooOldError
from services.geometry.transforms import OF_ITSELF
from services.worker.stamp_joiner import DOUBLE as DOUBLE_STAMP
from services.worker.stamp_joiner import UNUSED
from tests.schemas.frames import header
from tests.services.cloud.scenes import detections

MS = 1_000_000


class Rig:
    """A robot whose points come ten times a second."""

    def __init__(self, target: str = "", tolerance_ms: int | None = None) -> None:
        self.tally = Tally(CameraKey("r1", "front"))
        tolerance_ns = None if tolerance_ms is None else tolerance_ms * MS
        self.waiting = CloudJoiner(self.tally, target=target, tolerance_ns=tolerance_ns)

    def found(self, seq: int, at_ms: int, now_s: float = 0.0) -> None:
        self.waiting.detections(found(seq, at_ms), now_s)

    def points(self, *at_ms: int) -> None:
        for at in at_ms:
            self.waiting.points(cloud(at))

    def took(self, now_s: float = 0.0) -> tuple[int, int | None] | None:
        """Return the detections' number and the points' time in ms of what is taken."""
        matched = self.waiting.take(now_s)
        if matched is None:
            return None
        at = None if matched.cloud is None else matched.cloud.header.stamp_ns // MS
        return matched.detections.header.seq, at


def stamped(seq: int, at_ms: int, frame_id: str) -> Header:
    return msgspec.structs.replace(header(seq=seq), stamp_ns=at_ms * MS, frame_id=frame_id)


def found(seq: int, at_ms: int) -> Detections:
    return msgspec.structs.replace(detections(), header=stamped(seq, at_ms, "lens"))


def cloud(at_ms: int) -> PointCloud:
    return PointCloud(
        header=stamped(0, at_ms, "lidar"),
        height=0,
        width=0,
        fields=[],
        is_bigendian=False,
        point_step=0,
        row_step=0,
        data=memoryview(b""),
        is_dense=True,
    )


def moved(parent: str, child: str, at_ms: int) -> Transforms:
    transform = Transform(
        frame_id=parent,
        child_frame_id=child,
        stamp_ns=at_ms * MS,
        translation=(0.0, 0.0, 0.0),
        rotation=(0.0, 0.0, 0.0, 1.0),
    )
    return Transforms(header=header(camera=""), transforms=[transform])


def test_detections_get_the_points_nearest_in_time_within_half_a_period() -> None:
    rig = Rig()
    rig.points(1000, 1100, 1200)
    rig.found(1, 1140)
    assert rig.took() == (1, 1100)
    rig.found(2, 1160)
    assert rig.took() == (2, 1200)
    assert rig.took() is None


def test_they_wait_for_points_that_may_still_come_but_not_for_ever() -> None:
    rig = Rig()
    rig.points(1000, 1100)
    rig.found(1, 1200, now_s=5.0)
    assert rig.took(5.0) is None
    assert rig.waiting.until_s == 5.0 + POINTS_WAIT_S
    rig.points(1200)
    assert rig.took(5.1) == (1, 1200)
    rig.found(2, 1300, now_s=6.0)
    assert rig.took(6.0 + POINTS_WAIT_S) == (2, None)
    assert rig.waiting.until_s is None


def test_points_of_the_turn_before_are_taken_only_where_nearer_ones_do_not_come() -> None:
    rig = Rig(tolerance_ms=100)
    rig.points(1000, 1100)
    rig.found(1, 1150)
    assert rig.took() == (1, 1100)
    rig.found(2, 1200)
    assert rig.took() is None
    rig.points(1200)
    assert rig.took() == (2, 1200)
    rig.found(3, 1300)
    assert rig.took(POINTS_WAIT_S - 0.01) is None
    assert rig.took(POINTS_WAIT_S) == (3, 1200)


def test_pictures_faster_than_points_each_get_some_within_the_patience() -> None:
    rig = Rig(tolerance_ms=100)
    rig.points(*range(0, 1100, 100))
    for seq, at in enumerate((1033, 1066, 1100)):
        rig.found(seq, at, now_s=at / 1000)
    assert rig.took(1.1) == (0, 1000)
    assert rig.took(1.1) is None
    assert rig.took(1.066 + POINTS_WAIT_S) == (1, 1000)
    assert rig.took(1.1 + POINTS_WAIT_S) == (2, 1000)


def test_how_long_they_waited_is_said() -> None:
    rig = Rig()
    rig.points(1000, 1100)
    rig.found(1, 1200, now_s=5.0)
    assert rig.took(5.125) is None
    rig.points(1200)
    matched = rig.waiting.take(5.25)
    assert matched is not None
    assert matched.waited_s == 0.25


def test_points_that_will_never_come_are_not_waited_for() -> None:
    rig = Rig()
    rig.points(1000, 1100, 1400)
    rig.found(1, 1250)
    matched = rig.waiting.take(0.0)
    assert matched is not None
    assert matched.cloud is None
    assert matched.unknown.startswith("no points of its instant: the nearest is 0.150 s")


def test_the_newest_that_can_be_joined_counts_and_those_before_it_are_dropped() -> None:
    rig = Rig()
    rig.points(1000, 1100)
    for seq, at in ((1, 1000), (2, 1100), (3, 1200)):
        rig.found(seq, at)
    assert rig.took() == (2, 1100)
    assert rig.tally.dropped == {REPLACED: 1}
    rig.points(1200)
    assert rig.took() == (3, 1200)


def test_detections_faster_than_points_starve_nobody() -> None:
    rig = Rig()
    rig.points(1000, 1100)
    for seq in range(3 * MAX_WAITING):
        rig.found(seq, 1300 + 30 * seq, now_s=seq * 0.03)
        if (took := rig.took(seq * 0.03)) is not None:
            assert took[1] is None
    assert 0 < rig.tally.dropped[REPLACED] < 3 * MAX_WAITING


def test_the_same_detections_again_are_counted() -> None:
    rig = Rig()
    rig.points(1000)
    rig.found(1, 1000)
    rig.found(1, 1000)
    assert rig.took() == (1, 1000)
    assert rig.took() is None
    assert rig.tally.dropped[DUPLICATE] == 1


def test_detections_of_a_worker_that_is_behind_another_take_no_newer_ones_place() -> None:
    rig = Rig()
    rig.found(2, 1100)
    rig.found(1, 1000)
    rig.points(1000, 1100)
    assert rig.took() == (2, 1100)
    assert rig.took() is None
    assert (rig.tally.dropped[DUPLICATE], rig.tally.dropped[REPLACED]) == (1, 0)


def test_detections_of_another_gateway_process_count_anew() -> None:
    rig = Rig()
    rig.points(1000)
    rig.found(7, 900)
    other = found(0, 1000)
    rig.waiting.detections(msgspec.structs.replace(other, header=msgspec.structs.replace(other.header, boot_id="b")), 0)
    assert rig.took() == (0, 1000)


def test_a_transform_that_may_still_come_is_waited_for() -> None:
    rig = Rig(target="base_link")
    rig.waiting.transforms(moved("base_link", "lens", 0), static=True)
    rig.waiting.transforms(moved("base_link", "lidar", 900), static=False)
    rig.points(1000)
    rig.found(1, 1000)
    assert rig.took(0.1) is None
    rig.waiting.transforms(moved("base_link", "lidar", 1100), static=False)
    assert rig.took(0.1) == (1, 1000)


def test_a_transform_that_does_not_come_is_not_waited_for_for_ever() -> None:
    rig = Rig(target="base_link")
    rig.waiting.transforms(moved("base_link", "lidar", 900), static=False)
    rig.points(1000)
    rig.found(1, 1000)
    assert rig.took(POINTS_WAIT_S - 0.01) is None
    assert rig.took(POINTS_WAIT_S) == (1, 1000)


@pytest.mark.parametrize("fixed", ["map", "odom"])
def test_where_the_camera_was_at_its_own_instant_is_waited_for(fixed: str) -> None:
    rig = Rig()
    rig.waiting.transforms(moved("base_link", "lens", 0), static=True)
    rig.waiting.transforms(moved("base_link", "lidar", 0), static=True)
    for at in (900, 1000):
        rig.waiting.transforms(moved(fixed, "base_link", at), static=False)
    rig.points(1000)
    rig.found(1, 1015)
    assert rig.took(0.1) is None
    rig.waiting.transforms(moved(fixed, "base_link", 1100), static=False)
    assert rig.took(0.1) == (1, 1000)


@pytest.mark.parametrize("fixed", ["map", "odom"])
def test_where_the_lidar_was_at_an_instant_after_the_pictures_is_waited_for(fixed: str) -> None:
    rig = Rig()
    rig.waiting.transforms(moved("base_link", "lens", 0), static=True)
    rig.waiting.transforms(moved("base_link", "lidar", 0), static=True)
    for at in (900, 1000):
        rig.waiting.transforms(moved(fixed, "base_link", at), static=False)
    rig.found(1, 1000)
    rig.points(1015)
    assert rig.took(0.1) is None
    rig.waiting.transforms(moved(fixed, "base_link", 1100), static=False)
    assert rig.took(0.1) == (1, 1015)


def test_one_frame_that_stands_still_is_enough() -> None:
    rig = Rig()
    rig.waiting.transforms(moved("base_link", "lens", 0), static=True)
    rig.waiting.transforms(moved("base_link", "lidar", 0), static=True)
    rig.waiting.transforms(moved("map", "odom", 900), static=False)
    for at in (900, 1100):
        rig.waiting.transforms(moved("odom", "base_link", at), static=False)
    rig.points(1000)
    rig.found(1, 1015)
    assert rig.took(0.1) == (1, 1000)


def test_odom_is_waited_for_though_map_is_known_already() -> None:
    rig = Rig()
    rig.waiting.transforms(moved("base_link", "lens", 0), static=True)
    rig.waiting.transforms(moved("base_link", "lidar", 0), static=True)
    for at in (900, 1100):
        rig.waiting.transforms(moved("map", "base_link", at), static=False)
    for at in (900, 1000):
        rig.waiting.transforms(moved("base_link", "odom", at), static=False)
    rig.points(1000)
    rig.found(1, 1015)
    assert rig.took(0.1) is None
    rig.waiting.transforms(moved("base_link", "odom", 1100), static=False)
    assert rig.took(0.1) == (1, 1000)


def test_odom_that_begins_too_late_for_an_instant_leaves_it_to_map() -> None:
    rig = Rig()
    rig.waiting.transforms(moved("base_link", "lens", 0), static=True)
    rig.waiting.transforms(moved("base_link", "lidar", 0), static=True)
    for at in (900, 1100):
        rig.waiting.transforms(moved("map", "base_link", at), static=False)
    rig.waiting.transforms(moved("base_link", "odom", 1010), static=False)
    rig.points(1000)
    rig.found(1, 1015)
    assert rig.took(0.1) == (1, 1000)


@pytest.mark.parametrize("fixed", ["map", "odom"])
def test_what_nobody_says_any_more_is_not_waited_for(fixed: str) -> None:
    rig = Rig()
    rig.waiting.transforms(moved("base_link", "lens", 0), static=True)
    rig.waiting.transforms(moved("base_link", "lidar", 0), static=True)
    rig.waiting.transforms(moved(fixed, "base_link", 900), static=False)
    rig.points(2000)
    rig.found(1, 2015)
    assert rig.took() == (1, 2000)


def test_what_nothing_was_ever_said_of_is_not_waited_for() -> None:
    rig = Rig(target="nowhere")
    rig.points(1000)
    rig.found(1, 1000)
    assert rig.took() == (1, 1000)


def test_a_clock_that_jumps_back_joins_nothing_of_before() -> None:
    rig = Rig()
    rig.points(9000, 9100)
    rig.points(1000)
    rig.found(1, 9100)
    assert rig.took() is None
    rig.found(2, 1000)
    assert rig.took() == (2, 1000)


def test_at_the_end_nothing_is_left() -> None:
    rig = Rig()
    rig.points(1000)
    rig.found(1, 1200)
    assert (rig.waiting.end(), rig.waiting.end()) == (1, 0)
    rig.found(2, 1000)
    assert rig.took() is None


def test_where_a_robot_is_is_not_guessed_from_where_it_was_when_somebody_last_asked() -> None:
    rig = Rig()
    rig.waiting.transforms(moved("base_link", "lens", 0), static=True)
    rig.waiting.transforms(moved("odom", "base_link", 1000), static=False)
    rig.waiting.end()
    rig.waiting.transforms(moved("odom", "base_link", 6000), static=False)
    rig.waiting.tree.lookup("base_link", "lens", 5000 * MS)
    with pytest.raises(TooOldError):
        rig.waiting.tree.lookup("odom", "lens", 5000 * MS)


def test_points_that_nobody_asked_for_and_transforms_that_mean_nothing_are_counted() -> None:
    rig = Rig()
    rig.points(1000, 1100, 1100, 4000)
    rig.waiting.transforms(moved("odom", "odom", 1000), static=False)
    assert rig.tally.dropped == {f"points: {DOUBLE_STAMP}": 1, f"points: {UNUSED}": 2, f"transforms: {OF_ITSELF}": 1}


def test_what_has_no_stamp_is_of_no_instant() -> None:
    rig = Rig()
    rig.points(0)
    assert rig.tally.dropped == {UNSTAMPED: 1}
    rig.found(1, 0)
    matched = rig.waiting.take(0.0)
    assert matched is not None
    assert (matched.cloud, matched.unknown) == (None, NO_STAMP)
