from typing import Final

import msgspec
import pytest

from schemas.header import Header
from schemas.keys import CameraKey
from services.monitor import robot_clocks as module
from services.monitor.robot_clocks import CLOCK_WAIT_NS, Arrival, ClockHoldback
from tests.services.monitor.inventory.seeing import FRONT, S, seen

AHEAD_NS: Final = -1_000_000 * S
NOW_NS: Final = 2_000_000 * S
REAR: Final = CameraKey("r2", "rear")


class Robots:
    """Knows what some robots' clocks show."""

    def __init__(self, *known: str) -> None:
        self.known = set(known)

    def __call__(self, header: Header, _: int) -> bool:
        return header.robot in self.known


def arrival(seq: int, taken_ns: int, received_ns: int = NOW_NS, key: CameraKey = FRONT) -> Arrival:
    """Return a list of a frame that was taken at a time of our clock; the robot's is `AHEAD_NS` ahead."""
    made = seen(seq, {"box": 1}, key=key)
    header = msgspec.structs.replace(made.header, received_ns=taken_ns + AHEAD_NS)
    return Arrival(msgspec.structs.replace(made, header=header), received_ns / S, received_ns)


def test_what_comes_live_or_from_a_robot_whose_clock_is_known_is_taken_at_once() -> None:
    live, dated = arrival(1, NOW_NS), arrival(2, NOW_NS - 9 * S, key=REAR)
    undated = ClockHoldback(Robots("r2"))
    assert undated.arrive(live, kept=False) == [live]
    assert undated.arrive(dated, kept=True) == [dated]
    assert list(undated.due(NOW_NS)) == []


def test_kept_lists_and_what_follows_them_wait_until_their_robots_clock_is_known() -> None:
    robots = Robots()
    undated = ClockHoldback(robots)
    kept = [arrival(seq, NOW_NS - (9 - seq) * S) for seq in range(3)]
    live = arrival(3, NOW_NS + S, NOW_NS + S)
    other = arrival(1, NOW_NS, key=REAR)
    assert [undated.arrive(each, kept=True) for each in kept] == [[], [], []]
    assert undated.arrive(live, kept=False) == []
    assert undated.arrive(other, kept=False) == [other]
    assert list(undated.due(NOW_NS + S)) == []
    robots.known.add("r1")
    assert list(undated.due(NOW_NS + S)) == [[*kept, live]]
    assert undated.arrive(live, kept=False) == [live]


@pytest.mark.parametrize("then_ns", [NOW_NS + CLOCK_WAIT_NS, NOW_NS - 1], ids=["in vain", "our clock was set back"])
def test_where_nobody_says_what_the_clock_shows_lists_are_as_far_apart_as_their_frames(then_ns: int) -> None:
    undated = ClockHoldback(Robots())
    ages_s = (9, 5, 3)
    for seq, age_s in enumerate(ages_s):
        undated.arrive(arrival(seq, NOW_NS - age_s * S), kept=True)
    way_ns = S // 10
    undated.arrive(arrival(4, NOW_NS + S - way_ns, NOW_NS + S), kept=False)
    assert list(undated.due(NOW_NS + CLOCK_WAIT_NS - 1)) == []
    (taken,) = undated.due(then_ns)
    assert [each.received_ns for each in taken] == [*(NOW_NS - age_s * S + way_ns for age_s in ages_s), NOW_NS + S]
    assert [each.seen.header.seq for each in taken] == [0, 1, 2, 4]
    assert list(undated.due(NOW_NS + 9 * S)) == []


def test_no_more_wait_than_there_is_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_HELD_BACK", 3)
    undated = ClockHoldback(Robots())
    assert undated.arrive(arrival(1, NOW_NS, key=REAR), kept=True) == []
    for seq in (1, 2):
        assert undated.arrive(arrival(seq, NOW_NS - S), kept=True) == []
    assert [each.seen.header.seq for each in undated.arrive(arrival(3, NOW_NS), kept=True)] == [1, 2, 3]
    assert undated.arrive(arrival(2, NOW_NS, key=REAR), kept=True) == []


def test_what_arrives_while_others_are_taken_in_is_behind_them() -> None:
    undated = ClockHoldback(Robots())
    first, second = arrival(1, NOW_NS), arrival(2, NOW_NS)
    for key in (FRONT, REAR):
        undated.arrive(arrival(1, NOW_NS, key=key), kept=True)
    taking = undated.due(NOW_NS + CLOCK_WAIT_NS)
    assert next(taking) == [first]
    assert undated.arrive(second, kept=False) == [second]
    rear = [each.seen.header.seq for each in next(taking)]
    assert (rear, list(taking)) == ([1], [])


@pytest.mark.parametrize("set_by_ns", [3 * 86_400 * S, -3 * 86_400 * S])
def test_lists_of_before_a_robots_clock_was_set_are_as_they_came(set_by_ns: int) -> None:
    undated = ClockHoldback(Robots())
    before, after = arrival(1, NOW_NS - 2 * S - set_by_ns), arrival(2, NOW_NS - S)
    live = arrival(3, NOW_NS + S, NOW_NS + S)
    for each, kept in ((before, True), (after, True), (live, False)):
        undated.arrive(each, kept=kept)
    (taken,) = undated.due(NOW_NS + CLOCK_WAIT_NS)
    assert [each.received_ns for each in taken] == [NOW_NS, NOW_NS - S, NOW_NS + S]
