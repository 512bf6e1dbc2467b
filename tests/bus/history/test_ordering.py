"""The order of what publishers sent, whatever way it comes."""

import pytest

from bus.history import key_state, ordering
from bus.history.key_state import LATE_RUN, Fetch
from bus.history.ordering import BACKLOG
from tests.bus.history.receiving import HERE, KEY, OURS, Received, message


def test_what_is_kept_comes_first_and_once() -> None:
    got = Received()
    got.appear(kept=None)
    got.live(3, 4)
    assert got.messages == []
    got.answer(1, 2, 3)
    got.live(5)
    assert got.outcome == ([1, 2, 3, 4, 5], 0)
    assert got.fetches == [Fetch(KEY, HERE)]


def test_where_the_last_is_enough_what_is_live_waits_for_nothing() -> None:
    got = Received(recover=1)
    got.appear(kept=None)
    got.live(3)
    assert got.messages == [3]
    got.answer(2)
    got.live(4)
    assert got.outcome == ([3, 4], 0)


@pytest.mark.parametrize("recover", [1, 9])
def test_a_cache_that_has_nothing_is_asked_once_more_a_while_later(recover: int) -> None:
    got = Received(recover)
    got.appear(kept=None)
    got.nothing()
    assert got.doubts == got.fetches == [Fetch(KEY, HERE)]
    got.ask_again()
    got.answer(*range(10 - recover, 10))
    got.live(10)
    assert got.outcome == ([*range(10 - recover, 10), 10], 0)
    assert (len(got.doubts), len(got.fetches)) == (1, 2)


def test_what_is_live_waits_meanwhile_where_something_is_missing_before_it() -> None:
    got = Received()
    got.appear(kept=None)
    got.nothing()
    got.live(1)
    assert got.messages == [1], "a publisher's first waits for nothing"
    got.live(2, 5)
    assert got.messages == [1, 2]
    got.ask_again()
    assert got.fetches[-1] == Fetch(KEY, HERE, ((OURS, 2),))
    got.answer(3, 4, 5)
    got.live(6)
    assert got.outcome == ([1, 2, 3, 4, 5, 6], 0)


def test_zenohs_own_numbers_begin_with_0() -> None:
    got = Received()
    got.appear(kept=None)
    got.history.live([message(1)._replace(publisher="session/1")])
    assert got.messages == []
    for number in (0, 1):
        got.history.kept(got.fetches[-1], message(number)._replace(publisher="session/1"))
    got.history.fetched(got.fetches[-1])
    assert got.outcome == ([0, 1], 0)


def test_what_is_live_waits_no_longer_than_until_there_is_really_nothing() -> None:
    got = Received()
    got.appear(kept=None)
    got.nothing()
    got.live(5, 6)
    assert got.messages == []
    got.ask_again()
    got.nothing()
    assert got.outcome == ([5, 6], 0)
    assert len(got.doubts) == 1
    got.history.cut_off()
    got.appear(kept=None)
    got.nothing()
    assert len(got.doubts) == 2, "the next link is new, too"


def test_a_cache_that_is_gone_is_not_asked_again_and_what_waits_is_taken() -> None:
    got = Received()
    got.appear(kept=None)
    got.nothing()
    got.live(5)
    got.history.leave(KEY, HERE)
    got.ask_again()
    got.nothing()
    assert (got.outcome, len(got.doubts)) == (([5], 0), 1)


@pytest.mark.parametrize("recover", [1, 9])
def test_what_a_cache_has_does_not_overtake_what_is_on_its_way(recover: int) -> None:
    got = Received(recover)
    got.appear(kept=None)
    got.live(2, 3)
    got.answer(5)  # put after those two, so that it comes live, after 4
    got.live(4, 5)
    assert got.outcome == ([2, 3, 4, 5], 0)


def test_what_comes_live_after_the_cache_had_it_comes_once() -> None:
    got = Received()
    got.appear(kept=[4, 5])
    got.live(4, 5, 6)
    assert got.outcome == ([4, 5, 6], 0)


@pytest.mark.parametrize("recover", [1, 9, 100])
@pytest.mark.parametrize("ahead", [1_000, 1 << 30])
def test_one_number_far_ahead_makes_what_follows_old_for_a_few_messages_alone(recover: int, ahead: int) -> None:
    got = Received(recover)
    got.appear(kept=None)
    got.answer(1, 2)
    got.live(3, ahead)
    if recover > 1:
        got.answer()
    got.live(*range(4, 30))
    assert got.messages == [1, 2, 3, ahead, *range(3 + LATE_RUN, 30)]
    assert got.missed >= LATE_RUN - 1
    got.live(30, 31)
    assert got.messages[-2:] == [30, 31]


@pytest.mark.parametrize("recover", [1, 9, 100])
def test_so_does_one_that_comes_first(recover: int) -> None:
    got = Received(recover)
    got.live(1 << 30)
    got.live(*range(1, 20))
    assert got.messages == [1 << 30, *range(LATE_RUN, 20)]


@pytest.mark.parametrize("ahead", [BACKLOG + LATE_RUN + 4, 60_000, 1 << 30])
def test_so_does_one_that_a_cache_has(ahead: int) -> None:
    got = Received(9)
    got.appear(kept=[1, 2, ahead])
    got.live(*range(3, 30))
    assert got.messages == [1, 2, ahead, *range(2 + LATE_RUN, 30)]


def test_one_that_is_far_ahead_again_and_again_does_no_more() -> None:
    got = Received(1)
    for number in range(1, 100):
        got.live(number)
        if number % 20 == 0:
            got.live(1 << 30)
    assert len([each for each in got.messages if each < 1 << 30]) == 99 - 4 * (LATE_RUN - 1)


@pytest.mark.parametrize("recover", [1, 100])
@pytest.mark.parametrize("kept", [20, 300])
def test_many_that_are_on_their_way_when_a_cache_has_them_come_once(recover: int, kept: int) -> None:
    got = Received(recover)
    got.appear(kept=range(1, kept) if recover > 1 else [kept - 1])
    got.live(*range(1, kept + 5))
    first = 1 if recover > 1 else kept - 1
    assert got.outcome == (list(range(first, kept + 5)), 0)


def test_publishers_of_other_keys_are_not_waited_for() -> None:
    got = Received()
    got.appear(kept=None)
    got.live(7, key="fleet/r2/front/classes")
    assert got.messages == [7]


def test_publishers_of_a_key_have_numbers_of_their_own() -> None:
    got = Received()
    got.live(5, publisher=1)
    got.live(2, publisher=2)
    got.live(6, publisher=1)
    got.live(4, publisher=2)
    assert got.outcome == ([5, 2, 6, 4], 1)


def test_only_the_publishers_of_a_key_that_were_heard_last_are_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(key_state, "PUBLISHERS_REMEMBERED", 2)
    got = Received()
    for publisher in range(3):
        got.live(0, publisher=publisher)
    got.live(0, publisher=2)
    got.live(0, publisher=0)
    assert got.messages == [0, 0, 0, 0]
    got.live(1, publisher=2)
    got.live(0, publisher=1)
    got.live(1, publisher=2)
    assert got.messages == [0, 0, 0, 0, 1, 0]


def test_who_has_no_cache_is_not_waited_for() -> None:
    got = Received()
    got.live(5, 6, 9)
    assert got.outcome == ([5, 6, 9], 2)
    assert got.fetches == []


def test_a_hole_is_filled_where_more_than_the_last_is_wanted() -> None:
    got = Received()
    got.appear()
    got.live(0, 1, 4, 5)
    assert got.messages == [0, 1]
    assert got.fetches[1:] == [Fetch(KEY, HERE, ((OURS, 1),))]
    got.answer(2, 3, 4, 5)
    assert got.outcome == ([0, 1, 2, 3, 4, 5], 0)


@pytest.mark.parametrize("has_it", [True, False])
def test_a_hole_that_opens_while_a_cache_is_asked_is_asked_for_once_more(*, has_it: bool) -> None:
    got = Received()
    got.appear(kept=None)
    got.live(1, 2, 4, 5)
    got.answer(1, 2)
    assert got.messages == [1, 2]
    got.answer(*([3] if has_it else []), 4, 5)
    assert got.outcome == (([1, 2, 3, 4, 5], 0) if has_it else ([1, 2, 4, 5], 1))
    assert len(got.fetches) == 2


@pytest.mark.parametrize("recover", [1, 9])
def test_who_was_out_of_reach_for_a_while_has_its_newest_taken_from_its_cache(recover: int) -> None:
    got = Received(recover)
    got.appear()
    got.live(0, 1)
    got.history.leave(KEY, HERE)
    got.appear(kept=[2])
    assert got.outcome == ([0, 1, 2], 0)


def test_what_was_under_way_before_a_cut_says_nothing_of_what_is_now() -> None:
    got = Received(recover=1)
    got.appear()
    got.history.cut_off()
    got.appear(kept=None)
    got.history.live([message(0)], current=False)
    got.answer(3)
    assert got.outcome == ([0, 3], 2)


def test_what_no_cache_has_any_more_is_missed() -> None:
    got = Received()
    got.appear()
    got.live(0, 5)
    got.answer(4, 5)
    assert got.outcome == ([0, 4, 5], 3)


def test_a_publisher_that_counts_from_elsewhere_has_lost_nothing() -> None:
    got = Received(recover=1)
    got.appear()
    got.live(0, 2**64 - 1)
    assert got.outcome == ([0, 2**64 - 1], 0)


def test_a_hole_is_only_counted_where_the_last_is_enough() -> None:
    got = Received(recover=1)
    got.appear()
    got.live(0, 3)
    assert got.outcome == ([0, 3], 2)
    assert len(got.fetches) == 1


def test_old_and_doubled_ones_are_left_out() -> None:
    got = Received()
    got.appear()
    got.live(0, 1, 1, 0, 2)
    assert got.outcome == ([0, 1, 2], 0)


def test_numbers_may_start_anew_at_their_end() -> None:
    got = Received()
    got.appear()
    got.live(2**32 - 2, 2**32 - 1, 0, 1)
    assert got.outcome == ([2**32 - 2, 2**32 - 1, 0, 1], 0)


def test_a_cache_that_never_answers_holds_a_key_up_for_a_while_only() -> None:
    received = Received()
    received.appear(kept=None)
    received.live(3, 4)
    assert received.messages == []
    received.history.end_hold(received.holds[-1])
    received.live(5)
    assert received.messages == [3, 4, 5]
    received.answer(1, 2, 5, 6)
    received.live(7)
    assert received.outcome == ([3, 4, 5, 6, 7], 0)


def test_what_is_held_over_a_cut_is_held_for_a_while_only() -> None:
    received = Received()
    received.appear(kept=None)
    received.live(3)
    before = len(received.holds)
    received.history.cut_off()
    assert len(received.holds) == before + 1
    received.appear(kept=None)
    received.history.end_hold(received.holds[-1])
    assert received.messages == [3]


def test_only_the_hold_that_was_meant_ends() -> None:
    received = Received()
    received.appear(kept=None)
    first = received.holds[-1]
    received.answer(1)
    received.live(2, 4)
    received.history.end_hold(first)
    assert received.messages == [1, 2], "4 waits for 3 by now"
    received.history.end_hold(received.holds[-1])
    assert received.outcome == ([1, 2, 4], 1)
    received.history.end_hold(first)


def test_no_more_bytes_wait_for_older_messages_than_may(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ordering, "MOST_HELD_BYTES", 30)
    got = Received()
    got.history.size = lambda _: 10
    got.appear(kept=None)
    got.live(3, 4, 5)
    assert got.messages == []
    got.live(6)
    assert got.messages == [3, 4, 5, 6]
