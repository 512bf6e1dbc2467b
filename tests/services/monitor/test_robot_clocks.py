"""Offsets of the robots' clocks, and class lists held back until they are known."""

from typing import Final

import msgspec
import pytest

from schemas.header import Header
from schemas.keys import CameraKey
from schemas.status import ClockReading
from services.monitor import robot_clocks as module
from services.monitor.robot_clocks import (
    CLOCK_WAIT_NS,
    MAX_UNCERTAINTY_NS,
    PERIOD_S,
    REMEMBERED_S,
    Arrival,
    ClockHoldback,
    Clocks,
)
from tests.services.monitor.inventory.seeing import FRONT, S, seen

NOW_NS = 1_700_000_000_000_000_000
AHEAD_NS = 5_000_000_000


def reading(*, at_ns: int = NOW_NS, ahead_ns: int = AHEAD_NS, clock_id: str = "theirs") -> ClockReading:
    theirs_ns = at_ns + ahead_ns
    return ClockReading(robot="r1", boot_id="b", clock_id=clock_id, received_ns=theirs_ns, sent_ns=theirs_ns)


def measured(*, way_ns: int = 1_000) -> Clocks:
    clocks = Clocks()
    clocks.due(["r1"], 0)
    clocks.take("r1", reading(), asked_ns=NOW_NS - way_ns, answered_ns=NOW_NS + way_ns)
    return clocks


def test_every_robot_is_due_at_once_and_then_now_and_again() -> None:
    clocks = Clocks()
    assert clocks.due(["r2", "r1"], 0) == ["r1", "r2"]
    assert clocks.due(["r1", "r2", "r3"], PERIOD_S - 0.1) == ["r3"]
    assert clocks.due(["r1", "r2", "r3"], PERIOD_S) == ["r1", "r2"]


def test_what_a_clock_shows_now() -> None:
    clocks = measured()
    assert clocks.theirs_ns("r1", "theirs", NOW_NS + 7) == NOW_NS + 7 + AHEAD_NS
    assert clocks.theirs_ns("r1", "another", NOW_NS) is None
    assert clocks.theirs_ns("r2", "theirs", NOW_NS) is None
    assert clocks.robot_ns("r1", NOW_NS + 7) == NOW_NS + 7 + AHEAD_NS
    assert clocks.robot_ns("r2", NOW_NS) == 0


def test_a_robot_that_went_is_remembered_while_what_its_clock_shows_is_known() -> None:
    clocks = measured()
    assert clocks.due(["r2"], REMEMBERED_S - 1) == ["r2"]
    long_ns = int(REMEMBERED_S * 1e9)
    assert clocks.theirs_ns("r1", "theirs", NOW_NS + long_ns // 2) == NOW_NS + long_ns // 2 + AHEAD_NS
    assert clocks.theirs_ns("r1", "theirs", NOW_NS + long_ns) is None
    clocks.due([], REMEMBERED_S)
    assert clocks.theirs_ns("r1", "theirs", NOW_NS) is None
    clocks.take("r1", reading(), asked_ns=NOW_NS, answered_ns=NOW_NS)
    assert clocks.theirs_ns("r1", "theirs", NOW_NS) is None
    assert clocks.due(["r1", "r2"], REMEMBERED_S + 1) == ["r1"]


def test_a_robot_on_another_machine_has_another_clock() -> None:
    clocks = measured()
    clocks.take("r1", reading(ahead_ns=9, clock_id="new"), asked_ns=NOW_NS - 50_000, answered_ns=NOW_NS + 50_000)
    assert clocks.theirs_ns("r1", "new", NOW_NS) == NOW_NS + 9
    assert clocks.theirs_ns("r1", "theirs", NOW_NS) is None


def test_an_offset_that_is_hardly_known_says_nothing() -> None:
    drift_ns = 20_000
    assert measured(way_ns=MAX_UNCERTAINTY_NS - drift_ns).theirs_ns("r1", "theirs", NOW_NS) is not None
    assert measured(way_ns=MAX_UNCERTAINTY_NS).theirs_ns("r1", "theirs", NOW_NS) is None


AHEAD_OF_US_NS: Final = -1_000_000 * S
ARRIVED_NS: Final = 2_000_000 * S
REAR: Final = CameraKey("r2", "rear")


class Robots:
    """Knows what some robots' clocks show."""

    def __init__(self, *known: str) -> None:
        self.known = set(known)

    def __call__(self, header: Header, _: int) -> bool:
        return header.robot in self.known


def arrival(seq: int, taken_ns: int, received_ns: int = ARRIVED_NS, key: CameraKey = FRONT) -> Arrival:
    """Return a list of a frame that was taken at a time of our clock; the robot's is `AHEAD_OF_US_NS` ahead."""
    made = seen(seq, {"box": 1}, key=key)
    header = msgspec.structs.replace(made.header, received_ns=taken_ns + AHEAD_OF_US_NS)
    return Arrival(msgspec.structs.replace(made, header=header), received_ns / S, received_ns)


def test_what_comes_live_or_from_a_robot_whose_clock_is_known_is_taken_at_once() -> None:
    live, dated = arrival(1, ARRIVED_NS), arrival(2, ARRIVED_NS - 9 * S, key=REAR)
    undated = ClockHoldback(Robots("r2"))
    assert undated.arrive(live, kept=False) == [live]
    assert undated.arrive(dated, kept=True) == [dated]
    assert list(undated.due(ARRIVED_NS)) == []


def test_kept_lists_and_what_follows_them_wait_until_their_robots_clock_is_known() -> None:
    robots = Robots()
    undated = ClockHoldback(robots)
    kept = [arrival(seq, ARRIVED_NS - (9 - seq) * S) for seq in range(3)]
    live = arrival(3, ARRIVED_NS + S, ARRIVED_NS + S)
    other = arrival(1, ARRIVED_NS, key=REAR)
    assert [undated.arrive(each, kept=True) for each in kept] == [[], [], []]
    assert undated.arrive(live, kept=False) == []
    assert undated.arrive(other, kept=False) == [other]
    assert list(undated.due(ARRIVED_NS + S)) == []
    robots.known.add("r1")
    assert list(undated.due(ARRIVED_NS + S)) == [[*kept, live]]
    assert undated.arrive(live, kept=False) == [live]


@pytest.mark.parametrize(
    "then_ns", [ARRIVED_NS + CLOCK_WAIT_NS, ARRIVED_NS - 1], ids=["in vain", "our clock was set back"]
)
def test_where_nobody_says_what_the_clock_shows_lists_are_as_far_apart_as_their_frames(then_ns: int) -> None:
    undated = ClockHoldback(Robots())
    ages_s = (9, 5, 3)
    for seq, age_s in enumerate(ages_s):
        undated.arrive(arrival(seq, ARRIVED_NS - age_s * S), kept=True)
    way_ns = S // 10
    undated.arrive(arrival(4, ARRIVED_NS + S - way_ns, ARRIVED_NS + S), kept=False)
    assert list(undated.due(ARRIVED_NS + CLOCK_WAIT_NS - 1)) == []
    (taken,) = undated.due(then_ns)
    assert [each.received_ns for each in taken] == [
        *(ARRIVED_NS - age_s * S + way_ns for age_s in ages_s),
        ARRIVED_NS + S,
    ]
    assert [each.seen.header.seq for each in taken] == [0, 1, 2, 4]
    assert list(undated.due(ARRIVED_NS + 9 * S)) == []


def test_no_more_wait_than_there_is_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_HELD_BACK", 6)
    undated = ClockHoldback(Robots())
    assert undated.arrive(arrival(1, ARRIVED_NS, key=REAR), kept=True) == []
    for seq in (1, 2):
        assert undated.arrive(arrival(seq, ARRIVED_NS - S), kept=True) == []
    assert [each.seen.header.seq for each in undated.arrive(arrival(3, ARRIVED_NS), kept=True)] == [1, 2, 3]
    assert undated.arrive(arrival(2, ARRIVED_NS, key=REAR), kept=True) == []


def test_what_arrives_while_others_are_taken_in_is_behind_them() -> None:
    undated = ClockHoldback(Robots())
    first, second = arrival(1, ARRIVED_NS), arrival(2, ARRIVED_NS)
    for key in (FRONT, REAR):
        undated.arrive(arrival(1, ARRIVED_NS, key=key), kept=True)
    taking = undated.due(ARRIVED_NS + CLOCK_WAIT_NS)
    assert next(taking) == [first]
    assert undated.arrive(second, kept=False) == [second]
    rear = [each.seen.header.seq for each in next(taking)]
    assert (rear, list(taking)) == ([1], [])


@pytest.mark.parametrize("set_by_ns", [3 * 86_400 * S, -3 * 86_400 * S])
def test_lists_of_before_a_robots_clock_was_set_are_as_they_came(set_by_ns: int) -> None:
    undated = ClockHoldback(Robots())
    before, after = arrival(1, ARRIVED_NS - 2 * S - set_by_ns), arrival(2, ARRIVED_NS - S)
    live = arrival(3, ARRIVED_NS + S, ARRIVED_NS + S)
    for each, kept in ((before, True), (after, True), (live, False)):
        undated.arrive(each, kept=kept)
    (taken,) = undated.due(ARRIVED_NS + CLOCK_WAIT_NS)
    assert [each.received_ns for each in taken] == [ARRIVED_NS, ARRIVED_NS - S, ARRIVED_NS + S]
