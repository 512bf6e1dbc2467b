"""Which cameras become available or silent, and which absences are confirmed."""

import pytest

from schemas.keys import CameraKey
from services.monitor.inventory.availability import AT_ONCE, PARTS, AbsenceTracker, AvailabilityTracker
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.liveness import NETWORK_GRACE_S, Heartbeat
from tests.services.monitor.inventory.seeing import FRONT, S, seen

STALE_NS = TrustLimits().stale_ns


class Watched:
    """An inventory, and which of its cameras are available. looks: how often one was looked at."""

    def __init__(self, *, available: bool = False) -> None:
        self.inventory = Inventory(TrustLimits(Debounce(1, 0, 1, 0)))
        self.looks = 0
        self.tracker = AvailabilityTracker(self.inventory, self._rule, available=available)
        self._seq = 0

    def _rule(self, camera: CameraView, now_ns: int) -> bool:
        self.looks += 1
        return camera.last_ns >= now_ns - STALE_NS

    def see(self, at_ns: int) -> None:
        self._seq += 1
        self.inventory.see(seen(self._seq, {}), at_ns)

    def turned(self, now_ns: int, *told: CameraView) -> list[CameraKey]:
        return [camera.key for camera in self.tracker.advance(now_ns, told)]


@pytest.mark.parametrize("available", [False, True])
def test_a_camera_turns_when_it_begins_to_speak_and_when_its_time_is_over(*, available: bool) -> None:
    watched = Watched(available=available)
    watched.see(S)
    assert watched.turned(S) == ([] if available else [FRONT])
    assert watched.turned(S + STALE_NS) == []
    assert watched.turned(S + STALE_NS + 1) == [FRONT]
    assert watched.turned(S + STALE_NS + 2) == []
    watched.see(9 * S)
    assert watched.turned(9 * S) == [FRONT]


def test_one_that_was_silent_from_the_beginning_ceases_to_speak_where_new_ones_do() -> None:
    watched = Watched(available=True)
    watched.see(S)
    assert watched.turned(9 * S) == [FRONT]


def test_one_that_goes_on_is_looked_at_once_in_a_while() -> None:
    watched = Watched()
    for tenths in range(10, 310):
        watched.see(tenths * S // 10)
        watched.turned(tenths * S // 10)
    assert watched.looks <= 2 + 30 * S // STALE_NS


def test_whoever_is_told_of_is_looked_at_at_once() -> None:
    inventory = Inventory()
    gone: set[CameraKey] = set()
    tracker = AvailabilityTracker(inventory, lambda camera, _: camera.key not in gone, available=False)
    inventory.see(seen(1, {}), S)
    view = inventory.camera(FRONT)
    assert view
    assert tracker.advance(S) == [view]
    gone.add(FRONT)
    assert (tracker.advance(2 * S), tracker.advance(2 * S, [view])) == ([], [view])
    gone.clear()
    assert tracker.advance(2 * S) == [view]


def test_a_clock_that_was_set_back_keeps_no_silence_secret() -> None:
    watched = Watched()
    watched.see(3_600 * S)
    assert watched.turned(3_600 * S) == [FRONT]
    watched.see(10 * S)
    assert watched.turned(10 * S) == []
    assert watched.turned(11 * S + STALE_NS) == [FRONT]


def test_what_came_before_the_clock_was_set_back_covers_no_silence_after_it() -> None:
    watched = Watched()
    watched.see(3_600 * S)
    assert watched.turned(3_600 * S) == [FRONT]
    assert watched.turned(10 * S) == []
    watched.see(11 * S)
    assert watched.turned(11 * S + STALE_NS + 1) == [FRONT]


@pytest.mark.parametrize(("cameras", "at_once"), [(AT_ONCE + 1, AT_ONCE), (PARTS * (AT_ONCE + 1), AT_ONCE + 1)])
def test_of_many_whose_time_is_over_some_are_looked_at_and_the_rest_next_time(cameras: int, at_once: int) -> None:
    inventory = Inventory()
    for number in range(cameras):
        inventory.see(seen(1, {}, key=CameraKey(f"r{number}", "front")), S)
    tracker = AvailabilityTracker(inventory, lambda camera, now_ns: camera.last_ns >= now_ns - STALE_NS, available=True)
    assert tracker.advance(2 * S, inventory.cameras()) == []
    silent = [len(tracker.advance(9 * S)) for _ in range(PARTS + 1)]
    assert (silent[0], sum(silent)) == (at_once, cameras)


def test_when_the_clock_was_set_back_all_are_looked_at() -> None:
    inventory = Inventory()
    for number in range(AT_ONCE + 1):
        inventory.see(seen(1, {}, key=CameraKey(f"r{number}", "front")), S)
    silent = False
    tracker = AvailabilityTracker(inventory, lambda *_: not silent, available=True)
    tracker.advance(9 * S, inventory.cameras())
    silent = True
    assert len(tracker.advance(8 * S)) == AT_ONCE + 1


LEASE_S = 2.0
STALE_S = TrustLimits().stale_ns / S
SETTLE_S = 3.0 + LEASE_S
NAMES = ("r1", "r2")


class Watch:
    """A monitor of two robots and a camera, on a clock that the test sets."""

    def __init__(self, limits: TrustLimits | None = None) -> None:
        self.inventory = Inventory(limits)
        self.heard_s: float | None = 0.0
        self.hearing = Heartbeat(lambda: self.heard_s, LEASE_S)
        self.absentees = AbsenceTracker(self.inventory, self.hearing)
        self._seq = 0
        for robot in NAMES:
            self.inventory.robot_presence(robot, alive=True)

    def see(self, at_s: float) -> None:
        self._seq += 1
        self.inventory.see(seen(self._seq, {}), round(at_s * S))

    def advance(self, now_s: float, *, heard: bool = True) -> None:
        """Hear the monitor's own message at once, or nothing at all."""
        self.heard_s = now_s if heard else None
        if self.hearing.advance(now_s):
            self.absentees.clear()

    def robots(self, now_s: float, *, heard: bool = True) -> dict[str, tuple[bool | None, float]]:
        """Return of each robot whether it is there, and since when it is not."""
        self.advance(now_s, heard=heard)
        self.ripen(now_s)
        found = {robot: self.absentees.look_at_robot(robot, round(now_s * S), now_s) for robot in NAMES}
        return {robot: (alive, at_ns / S) for robot, (alive, at_ns) in found.items()}

    def ripen(self, now_s: float) -> tuple[list[str], list[CameraView]]:
        return self.absentees.ripen(round(now_s * S), now_s)

    def silent_s(self, now_s: float, *, told: bool = False, ceased: bool = False) -> float | None:
        """Look at the camera; return since when it is surely silent."""
        self.advance(now_s)
        camera = self.inventory.camera(FRONT)
        assert camera
        self.absentees.look_at_camera(camera, round(now_s * S), now_s, told=told, ceased=ceased)
        self.ripen(now_s)
        since_ns = self.absentees.silent_ns(FRONT)
        return None if since_ns is None else since_ns / S


def test_a_robot_that_goes_is_surely_gone_a_moment_later_since_it_went() -> None:
    watch = Watch()
    assert watch.robots(10) == {"r1": (True, 10), "r2": (True, 10)}
    watch.inventory.robot_presence("r1", alive=False)
    assert watch.robots(11) == {"r1": (None, 11), "r2": (True, 11)}
    assert watch.robots(11 + NETWORK_GRACE_S) == {"r1": (False, 11), "r2": (True, 11 + NETWORK_GRACE_S)}
    assert watch.robots(60)["r1"] == (False, 11)
    watch.inventory.robot_presence("r1", alive=True)
    assert watch.robots(61)["r1"] == (True, 61)


def test_nobody_is_surely_gone_before_the_monitor_heard_itself_again() -> None:
    watch = Watch()
    watch.robots(10)
    watch.inventory.robot_presence("r1", alive=False)
    watch.robots(11)
    watch.hearing.advance(11 + 2 * NETWORK_GRACE_S)  # heard at 11 last
    assert watch.ripen(11 + 2 * NETWORK_GRACE_S) == ([], [])
    watch.advance(11 + 3 * NETWORK_GRACE_S)
    assert watch.ripen(11 + 3 * NETWORK_GRACE_S) == (["r1"], [])


def test_who_goes_with_the_monitors_own_link_may_be_there_though_the_link_is_missed_later() -> None:
    watch = Watch()
    watch.robots(10)
    for robot in NAMES:
        watch.inventory.robot_presence(robot, alive=False)
    assert {alive for alive, _ in watch.robots(11).values()} == {None}
    assert {alive for alive, _ in watch.robots(11 + NETWORK_GRACE_S / 2, heard=False).values()} == {None}
    assert {alive for alive, _ in watch.robots(60, heard=False).values()} == {None}
    assert {alive for alive, _ in watch.robots(100).values()} == {None}
    watch.inventory.robot_presence("r1", alive=True)
    assert watch.robots(101) == {"r1": (True, 101), "r2": (None, 101)}
    settled_s = 100 + SETTLE_S
    assert watch.robots(settled_s)["r2"] == (None, settled_s)
    assert watch.robots(settled_s + NETWORK_GRACE_S)["r2"] == (False, settled_s)


def test_what_a_monitor_that_cannot_hear_knew_of_robots_is_not_known_any_more() -> None:
    watch = Watch()
    watch.robots(10)
    watch.inventory.robot_presence("r1", alive=False)
    watch.robots(11)
    assert watch.robots(11 + NETWORK_GRACE_S)["r1"] == (False, 11)
    assert watch.robots(20, heard=False) == {"r1": (None, 20), "r2": (None, 20)}


def test_a_camera_is_silent_a_moment_after_its_lists_ended_or_once_its_link_would_be_lost() -> None:
    for stale_s, sure_s in ((3.0, NETWORK_GRACE_S), (0.5, NETWORK_GRACE_S + LEASE_S - 0.5)):
        watch = Watch(TrustLimits(stale_ns=round(stale_s * S)))
        watch.inventory.camera_presence(FRONT, alive=True)
        for at_s in (10, 10.1):
            watch.see(at_s)
        assert watch.silent_s(10.2) is None
        ceased_s = 10.2 + stale_s
        assert watch.silent_s(ceased_s, ceased=True) is None
        assert watch.silent_s(ceased_s + sure_s - 0.1) is None
        assert watch.silent_s(ceased_s + sure_s) == ceased_s
        watch.see(30)
        assert watch.silent_s(30.1) is None


def test_a_camera_that_joins_is_silent_once_it_was_there_without_a_list_for_the_stale_time() -> None:
    watch = Watch()
    watch.inventory.camera_presence(FRONT, alive=True)
    assert watch.silent_s(10, told=True) is None
    assert watch.silent_s(10.1) is None
    assert watch.silent_s(10 + STALE_S + NETWORK_GRACE_S - 0.1) is None
    assert watch.silent_s(10 + STALE_S + NETWORK_GRACE_S) == 10 + STALE_S


def test_a_camera_whose_lists_are_rare_is_silent_the_stale_time_after_its_newest() -> None:
    watch = Watch()
    watch.inventory.camera_presence(FRONT, alive=True)
    assert watch.silent_s(10, told=True) is None
    watch.see(12.9)
    assert watch.silent_s(10 + STALE_S + NETWORK_GRACE_S) is None
    assert watch.silent_s(12.9 + STALE_S + NETWORK_GRACE_S - 0.1) is None
    assert watch.silent_s(12.9 + STALE_S + NETWORK_GRACE_S) == 12.9 + STALE_S


def test_a_camera_that_went_is_silent_at_once_and_one_that_is_back_has_its_time() -> None:
    watch = Watch()
    watch.inventory.camera_presence(FRONT, alive=True)
    assert watch.silent_s(10, told=True) is None
    watch.see(10.1)
    watch.see(10.2)
    assert watch.silent_s(10.3) is None
    watch.inventory.camera_presence(FRONT, alive=False)
    assert watch.silent_s(10.4, told=True) is None
    assert watch.silent_s(10.4 + NETWORK_GRACE_S) == 10.4
    watch.inventory.camera_presence(FRONT, alive=True)
    assert watch.silent_s(20, told=True) is None
    assert watch.silent_s(20 + STALE_S + NETWORK_GRACE_S) == 20 + STALE_S


def test_a_camera_of_which_only_lists_or_history_tell_has_the_stale_time_to_come() -> None:
    watch = Watch()
    watch.see(10)
    assert watch.silent_s(10.1, told=True) is None
    assert watch.silent_s(10.1 + STALE_S + NETWORK_GRACE_S - 0.1) is None
    assert watch.silent_s(10.1 + STALE_S + NETWORK_GRACE_S) == 10.1 + STALE_S


def test_after_a_deaf_time_a_camera_has_the_stale_time_to_become_available() -> None:
    watch = Watch()
    watch.inventory.camera_presence(FRONT, alive=True)
    watch.silent_s(10, told=True)
    watch.advance(11, heard=False)
    watch.advance(20)
    settled_s = 20 + SETTLE_S
    assert watch.silent_s(settled_s) is None
    assert watch.silent_s(settled_s + STALE_S + NETWORK_GRACE_S - 0.1) is None
    assert watch.silent_s(settled_s + STALE_S + NETWORK_GRACE_S) == settled_s + STALE_S


def test_a_camera_without_lists_is_silent_also_where_its_link_comes_and_goes() -> None:
    watch = Watch()
    silent_s: list[float | None] = []
    for round_s in range(10, 40, 3):
        watch.inventory.camera_presence(FRONT, alive=True)
        watch.silent_s(round_s, told=True)
        silent_s.append(watch.silent_s(round_s + 2))
        watch.inventory.camera_presence(FRONT, alive=False)
        watch.silent_s(round_s + 2.1, told=True)
    assert silent_s[:1] == [None]
    assert silent_s[-1] == 10 + STALE_S
