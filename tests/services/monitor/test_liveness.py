"""Every state of robots, cameras, views, workers, poses and the monitor itself, and each transition between them."""

from collections.abc import Callable

import pytest

from schemas.keys import CameraKey
from services.monitor.fleet import Fleet
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.liveness import (
    HEARTBEAT_S,
    LOST_S,
    MIN_LISTS,
    OBJECT_FRESH_NS,
    POSE_LIVE_NS,
    ROBOT_SILENT_NS,
    STALE_S,
    WORKER_ONLINE_NS,
    CameraLiveness,
    Heartbeat,
    RobotState,
    camera_state,
    is_pose_live,
    is_recent,
    is_stale,
    is_view_current,
    is_worker_online,
    robot_state,
)
from services.monitor.settings import MonitorSettings
from tests.services.monitor.inventory.seeing import FRONT, S, seen

LEASE_S = 2.0
SETTLE_S = 3.0 + LEASE_S


class Ears:
    """What a monitor hears, on a clock that the test sets."""

    def __init__(self) -> None:
        self.heard_s: float | None = 0.0
        self.hearing = Heartbeat(lambda: self.heard_s, LEASE_S)

    def at(self, now_s: float, heard_s: float | None) -> tuple[bool, bool, bool]:
        """Return whether anything turned, whether it is deaf, and whether it has settled."""
        self.heard_s = heard_s
        turned = self.hearing.advance(now_s)
        return turned, self.hearing.deaf, self.hearing.settled


def test_who_hears_the_fleet_from_the_beginning_knows_who_is_there() -> None:
    ears = Ears()
    assert ears.at(1, 0.5) == (False, False, True)
    assert ears.hearing.heard_s == 0.5


def test_after_a_time_without_a_link_everybody_has_the_lease_and_three_seconds_to_appear() -> None:
    ears = Ears()
    assert ears.at(1, None) == (True, True, False)
    assert ears.at(2, None) == (False, True, False)
    assert ears.at(3, 3) == (True, False, False)
    assert ears.at(3 + SETTLE_S - 0.1, 7) == (False, False, False)
    assert ears.at(3 + SETTLE_S, 8) == (True, False, True)


def test_a_link_that_is_lost_again_meanwhile_lets_it_begin_anew() -> None:
    ears = Ears()
    ears.at(1, None)
    ears.at(2, 2)
    assert ears.at(4, None) == (True, True, False)
    ears.at(5, 5)
    assert ears.at(2 + SETTLE_S, 6) == (False, False, False)
    assert ears.at(5 + SETTLE_S, 9) == (True, False, True)


def test_who_was_held_up_was_deaf() -> None:
    ears = Ears()
    late_s = LEASE_S + 2 * HEARTBEAT_S
    assert ears.at(10, 10 - late_s) == (False, False, True)
    assert ears.at(10.1, 10 - late_s) == (True, True, False)
    assert ears.at(10.2, 10.2) == (True, False, False)


@pytest.mark.parametrize(
    ("age_s", "online", "stale", "state"),
    [
        (None, False, True, CameraLiveness.OFFLINE),
        (None, True, True, CameraLiveness.ONLINE),
        (STALE_S, True, False, CameraLiveness.ONLINE),
        (STALE_S + 0.1, True, True, CameraLiveness.SILENT),
        (0.0, False, True, CameraLiveness.OFFLINE),
    ],
    ids=["offline", "no list yet", "just recent", "silent", "gone"],
)
def test_a_camera_is_online_then_silent_and_offline_once_gone(
    age_s: float | None, *, online: bool, stale: bool, state: CameraLiveness
) -> None:
    assert is_stale(age_s, STALE_S, online=online) is stale
    assert camera_state(age_s, STALE_S, online=online) is state


@pytest.mark.parametrize(
    ("unheard_ns", "stale", "online", "has_problem", "state"),
    [
        (0, [False, True], True, False, RobotState.ONLINE),
        (ROBOT_SILENT_NS, [], True, False, RobotState.ONLINE),
        (0, [False], True, True, RobotState.TROUBLE),
        (ROBOT_SILENT_NS + 1, [False], True, True, RobotState.SILENT),
        (0, [True, True], True, True, RobotState.SILENT),
        (0, [False], False, True, RobotState.OFFLINE),
    ],
    ids=["one camera goes on", "no camera", "problem", "no message", "no list", "gateway gone"],
)
def test_a_robot_has_its_worst_state(
    unheard_ns: int, stale: list[bool], *, online: bool, has_problem: bool, state: RobotState
) -> None:
    assert robot_state(unheard_ns, stale, online=online, has_problem=has_problem) is state


def test_a_view_is_current_from_its_second_list_until_it_is_stale_or_lost() -> None:
    assert not is_view_current(MIN_LISTS - 1, 10, 10, lost=False)
    assert is_view_current(MIN_LISTS, 10, 10, lost=False)
    assert not is_view_current(MIN_LISTS, 9, 10, lost=False)
    assert not is_view_current(MIN_LISTS, 10, 10, lost=True)


@pytest.mark.parametrize(
    ("is_so", "limit_ns"),
    [
        (is_worker_online, WORKER_ONLINE_NS),
        (lambda last_ns, now_ns: is_pose_live(last_ns, now_ns, online=True), POSE_LIVE_NS),
        (lambda last_ns, now_ns: is_recent(last_ns, now_ns, OBJECT_FRESH_NS), OBJECT_FRESH_NS),
    ],
    ids=["worker", "pose", "object"],
)
def test_a_worker_pose_or_object_counts_until_its_limit(is_so: Callable[[int, int], bool], limit_ns: int) -> None:
    assert is_so(S, S + limit_ns)
    assert not is_so(S, S + limit_ns + 1)


def test_the_pose_of_an_offline_robot_is_not_live() -> None:
    assert not is_pose_live(S, S, online=False)


def test_the_options_default_to_these_thresholds() -> None:
    settings, limits = MonitorSettings(), TrustLimits()
    assert (settings.stale_s, settings.lost_s) == (STALE_S, LOST_S)
    assert (limits.stale_ns, limits.lost_ns) == (settings.limits().stale_ns, settings.limits().lost_ns)


def test_a_camera_goes_through_all_states_in_the_inventory() -> None:
    inventory = Inventory(TrustLimits(Debounce(1, 0, 1, 0)))
    inventory.robot_presence("r1", alive=True)
    inventory.camera_presence(FRONT, alive=True)
    inventory.see(seen(1, {"box": 1}), S)
    view = inventory.camera(FRONT)
    assert view
    assert (inventory.online(FRONT), inventory.is_available(view, S)) == (True, False), "the first may be a kept one"
    inventory.see(seen(2, {"box": 1}), 2 * S)
    stale_ns, lost_ns = 2 * S + round(STALE_S * S), 2 * S + round(LOST_S * S)
    assert inventory.is_available(view, stale_ns)
    assert not inventory.is_available(view, stale_ns + 1)
    assert (inventory.tick(lost_ns), view.lost) == ([], False)
    assert ([change.kind for change in inventory.tick(lost_ns + 1)], view.lost) == (["lost"], True)
    inventory.see(seen(3, {"box": 1}), lost_ns + 2 * S)
    inventory.see(seen(4, {"box": 1}), lost_ns + 3 * S)
    assert inventory.is_available(view, lost_ns + 3 * S)
    inventory.camera_presence(FRONT, alive=False)
    assert (inventory.online(FRONT), inventory.is_available(view, lost_ns + 3 * S)) == (False, False)
    inventory.camera_presence(FRONT, alive=True)
    inventory.robot_presence("r1", alive=False)
    assert not inventory.online(FRONT), "its robot is gone"


def test_a_row_shows_the_state_of_its_camera() -> None:
    fleet = Fleet("clock")
    assert (fleet.row(FRONT, 1).state, fleet.row(FRONT, 1).stale) == (CameraLiveness.OFFLINE, True)
    fleet.robot_presence("r1", alive=True)
    fleet.camera_presence(FRONT, alive=True)
    assert fleet.row(FRONT, 1).state is CameraLiveness.ONLINE
    fleet.see(seen(1, {}), 1, S)
    assert [fleet.row(FRONT, 1 + age_s).state for age_s in (STALE_S, STALE_S + 0.1)] == ["online", "silent"]
    assert fleet.row(CameraKey("r1", "rear"), 1).age_s is None
