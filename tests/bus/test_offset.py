from hypothesis import given
from hypothesis import strategies as st

from bus.clocks import MAX_DRIFT, WINDOW, ClockOffset, Exchange, Offset

S = 1_000_000_000
START_NS = 1_700_000_000 * S

waits = st.integers(0, 30 * S)
ways = st.integers(0, 2 * S)
offsets = st.integers(-START_NS, START_NS)
drifts = st.floats(-MAX_DRIFT / 2, MAX_DRIFT / 2)


def exchange(asked_ns: int, *, ahead_ns: int, there_ns: int, work_ns: int, back_ns: int) -> Exchange:
    received_ns = asked_ns + there_ns + ahead_ns
    return Exchange(asked_ns, received_ns, received_ns + work_ns, asked_ns + there_ns + work_ns + back_ns)


def test_nothing_is_known_before_the_first_exchange() -> None:
    assert ClockOffset().at(START_NS) is None


def test_the_same_way_there_and_back_shows_the_offset() -> None:
    clock = ClockOffset()
    clock.add(exchange(START_NS, ahead_ns=5 * S, there_ns=1000, work_ns=S, back_ns=1000))
    found = clock.at(START_NS)
    assert found == Offset(5 * S, 1002)


@given(offsets, drifts, st.lists(st.tuples(waits, ways, ways, ways), min_size=1, max_size=40))
def test_the_offset_is_within_its_uncertainty(
    ahead_ns: int, drift: float, course: list[tuple[int, int, int, int]]
) -> None:
    """However long the ways are and however the clocks drift apart within what is allowed."""

    def theirs(ours_ns: int) -> int:
        return ours_ns + ahead_ns + round((ours_ns - START_NS) * drift)

    clock, now_ns = ClockOffset(), START_NS
    for wait_ns, there_ns, work_ns, back_ns in course:
        asked_ns = now_ns + wait_ns
        received_at, sent_at = asked_ns + there_ns, asked_ns + there_ns + work_ns
        now_ns = sent_at + back_ns
        clock.add(Exchange(asked_ns, theirs(received_at), theirs(sent_at), now_ns))
        for later_ns in (now_ns, now_ns + 60 * S):
            found = clock.at(later_ns)
            assert found is not None
            assert abs(found.offset_ns - (theirs(later_ns) - later_ns)) <= found.uncertainty_ns


def test_the_shortest_round_trip_wins_until_drift_makes_it_worth_less() -> None:
    clock = ClockOffset()
    clock.add(exchange(START_NS, ahead_ns=0, there_ns=1_000_000, work_ns=0, back_ns=1_000_000))
    clock.add(exchange(START_NS + S, ahead_ns=0, there_ns=0, work_ns=0, back_ns=9_000_000))
    at_once = clock.at(START_NS + S)
    assert at_once is not None
    assert (at_once.offset_ns, at_once.uncertainty_ns) == (0, 1_000_000 + 100_000 + 2)
    clock.add(exchange(START_NS + 100 * S, ahead_ns=0, there_ns=0, work_ns=0, back_ns=9_000_000))
    later = clock.at(START_NS + 100 * S)
    assert later == Offset(-4_500_000, 4_500_002)


@given(st.integers(3 * S, START_NS) | st.integers(-START_NS, -3 * S))
def test_a_clock_that_is_set_is_believed_at_once(jump_ns: int) -> None:
    clock = ClockOffset()
    for turn in range(4):
        clock.add(exchange(START_NS + turn * S, ahead_ns=0, there_ns=S // 2, work_ns=0, back_ns=S // 2))
    clock.add(exchange(START_NS + 5 * S, ahead_ns=jump_ns, there_ns=S // 2, work_ns=0, back_ns=S // 2))
    found = clock.at(START_NS + 6 * S)
    assert found is not None
    assert found.offset_ns == jump_ns


def test_an_exchange_during_which_a_clock_was_set_says_nothing() -> None:
    clock = ClockOffset()
    for impossible in (
        Exchange(START_NS, 10, 20, START_NS - 1),
        Exchange(START_NS, 20, 10, START_NS + 100),
        Exchange(START_NS, 0, 102, START_NS + 100),
    ):
        clock.add(impossible)
    assert clock.at(START_NS) is None


def test_what_is_remembered_is_bounded() -> None:
    clock = ClockOffset()
    clock.add(exchange(START_NS, ahead_ns=0, there_ns=0, work_ns=0, back_ns=0))
    for turn in range(1, WINDOW + 1):
        clock.add(exchange(START_NS + turn, ahead_ns=0, there_ns=0, work_ns=0, back_ns=100))
    found = clock.at(START_NS)
    assert found is not None
    assert found.uncertainty_ns == 53
