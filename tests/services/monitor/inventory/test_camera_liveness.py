import pytest

from schemas.keys import CameraKey
from services.monitor.inventory.availability import AT_ONCE, PARTS, AvailabilityTracker
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.inventory.sighting import Debounce
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
        inventory.see(seen(1, {}, key=CameraKey("r1", f"c{number}")), S)
    tracker = AvailabilityTracker(inventory, lambda camera, now_ns: camera.last_ns >= now_ns - STALE_NS, available=True)
    assert tracker.advance(2 * S, inventory.cameras()) == []
    silent = [len(tracker.advance(9 * S)) for _ in range(PARTS + 1)]
    assert (silent[0], sum(silent)) == (at_once, cameras)


def test_when_the_clock_was_set_back_all_are_looked_at() -> None:
    inventory = Inventory()
    for number in range(AT_ONCE + 1):
        inventory.see(seen(1, {}, key=CameraKey("r1", f"c{number}")), S)
    silent = False
    tracker = AvailabilityTracker(inventory, lambda *_: not silent, available=True)
    tracker.advance(9 * S, inventory.cameras())
    silent = True
    assert len(tracker.advance(8 * S)) == AT_ONCE + 1
