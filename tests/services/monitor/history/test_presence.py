"""Presence of robots, cameras and monitors, and stored poses."""

from collections import deque
from math import inf, nan

from schemas.keys import CameraKey
from services.monitor.history.interval_buffer import IntervalBuffer
from services.monitor.history.presence import Attendance, KnownPoses, Presence
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.liveness import SETTLE_NS
from services.monitor.map.last_seen import SightingMap
from services.monitor.map.pose import Pose
from tests.services.monitor.history.support.stored_intervals import there
from tests.services.monitor.inventory.seeing import FRONT, S, seen

STALE_S = TrustLimits().stale_ns // S


class Fleet:
    """A fleet, and who was entered in the buffer as robot/camera, since, until and open."""

    def __init__(self) -> None:
        self.inventory = Inventory(TrustLimits(Debounce(1, 0, 1, 0)))
        self.buffer = IntervalBuffer()
        self.attendance = Attendance(self.inventory, self.buffer)
        self._seq = 0

    def see(self, at_s: int) -> None:
        self._seq += 1
        self.inventory.see(seen(self._seq, {}), at_s * S)

    def noted(self, at_s: int) -> list[tuple[str, int, int, bool]]:
        deque(self.attendance.note(at_s * S), maxlen=0)
        some = [each for each in self.buffer.pending(100) if isinstance(each, Presence)]
        self.buffer.written(some)
        return [(f"{of.robot}/{of.camera}", of.since_ns // S, of.until_ns // S, of.open) for of in some]


def test_a_robot_is_there_as_long_as_its_gateway_is() -> None:
    fleet = Fleet()
    assert fleet.noted(1) == []
    fleet.inventory.robot_presence("r1", alive=True)
    assert fleet.noted(2) == [("r1/", 2, 2, True)]
    assert fleet.noted(3) == []
    fleet.inventory.robot_presence("r1", alive=False)
    fleet.inventory.robot_presence("r2", alive=False)
    assert fleet.noted(4) == [("r1/", 2, 4, False)]
    fleet.inventory.robot_presence("r1", alive=True)
    assert fleet.noted(5) == [("r1/", 5, 5, True)]


def test_a_robot_that_was_gone_between_two_looks_costs_no_row() -> None:
    fleet = Fleet()
    fleet.inventory.robot_presence("r1", alive=True)
    fleet.noted(1)
    for alive in (False, True) * 50:
        fleet.inventory.robot_presence("r1", alive=alive)
    assert fleet.noted(2) == []


def test_a_camera_is_there_as_long_as_it_is_available() -> None:
    fleet = Fleet()
    fleet.inventory.robot_presence("r1", alive=True)
    fleet.inventory.camera_presence(FRONT, alive=True)
    fleet.see(1)
    assert fleet.noted(1) == [("r1/", 1, 1, True)], "one list may be that which late subscribers get"
    fleet.see(2)
    assert fleet.noted(2) == [("r1/front", 2, 2, True)]
    fleet.see(3)
    assert fleet.noted(3 + STALE_S) == []
    assert fleet.noted(4 + STALE_S) == [("r1/front", 2, 4 + STALE_S, False)]
    fleet.see(20)
    assert fleet.noted(20) == [("r1/front", 20, 20, True)]
    fleet.inventory.camera_presence(FRONT, alive=False)
    assert fleet.noted(21) == [("r1/front", 20, 21, False)]
    fleet.inventory.camera_presence(FRONT, alive=True)
    fleet.see(22)
    assert fleet.noted(22) == [("r1/front", 22, 22, True)]
    fleet.inventory.robot_presence("r1", alive=False)
    assert fleet.noted(23) == [("r1/", 1, 23, False), ("r1/front", 22, 23, False)]


def test_it_is_kept_when_a_silent_camera_was_heard_last() -> None:
    fleet = Fleet()
    fleet.inventory.robot_presence("r1", alive=True)
    fleet.inventory.camera_presence(FRONT, alive=True)
    for second in (1, 2, 3):
        fleet.see(second)
        fleet.noted(second)
    deque(fleet.attendance.note(9 * S), maxlen=0)
    (gone,) = fleet.buffer.pending(9)
    assert gone == Presence("r1", "front", 3 * S, since_ns=2 * S, until_ns=9 * S, open=False)


def test_who_is_back_at_once_after_a_restart_was_there_all_along() -> None:
    fleet = Fleet()
    settle_s = SETTLE_NS // S
    before = [there(1, 10), there(2, 10, "r2"), there(3, 10, "")]
    fleet.attendance.resume(before, 20 * S)
    fleet.attendance.lead(20 * S)
    fleet.inventory.robot_presence("r1", alive=True)
    fleet.inventory.robot_presence("r3", alive=True)
    assert sorted(fleet.noted(20 + settle_s)) == [("/", 20, 20, True), ("r1/", 1, 1, True), ("r3/", 23, 23, True)]
    fleet.inventory.robot_presence("r2", alive=True)
    assert fleet.noted(21 + settle_s) == [("r2/", 24, 24, True)], "it was missed by then"


def test_a_monitor_is_there_as_long_as_it_leads() -> None:
    fleet = Fleet()
    fleet.attendance.lead(5 * S)
    assert fleet.noted(6) == [("/", 5, 5, True)]
    fleet.attendance.follow()
    fleet.attendance.lead(9 * S)
    assert fleet.noted(9) == [("/", 9, 9, True)], "when the other one began says the other one"


def test_cameras_of_robots_that_are_recalled_alone_are_not_there() -> None:
    fleet = Fleet()
    fleet.inventory.recall({("r1", ""): 5 * S, ("r1", "front"): 5 * S}, 0)
    assert fleet.inventory.camera(CameraKey("r1", "front"))
    assert fleet.noted(9) == []


HERE, THERE = Pose(1.0, 2.0, 0.5, 7), Pose(3.0, 2.0, 0.5, 8)


def test_what_is_new_is_to_be_written_once() -> None:
    places = SightingMap()
    poses = KnownPoses(places)
    places.stand({"r1": HERE, "r2": HERE})
    assert dict(poses.pending()) == {"r1": HERE, "r2": HERE}
    poses.written({"r1": HERE})
    assert dict(poses.pending()) == {"r2": HERE}
    poses.written({"r2": HERE})
    places.stand({"r1": THERE})
    assert dict(poses.pending()) == {"r1": THERE}


def test_what_a_store_kept_is_on_the_map_and_not_written_again() -> None:
    places = SightingMap()
    poses = KnownPoses(places)
    places.stand({"r1": THERE})
    poses.restore({"r1": HERE, "r2": HERE})
    assert places.poses == {"r1": THERE, "r2": HERE}
    assert dict(poses.pending()) == {"r1": THERE}


def test_what_no_database_takes_is_not_written() -> None:
    places = SightingMap()
    poses = KnownPoses(places)
    places.stand({"r1": Pose(nan, 0, 0, 1), "r2": Pose(0, inf, 0, 1), "r3": Pose(0, 0, -nan, 1)})
    assert dict(poses.pending()) == {}
