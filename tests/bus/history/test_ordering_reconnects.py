"""The order of messages over cuts, caches that leave and publishers' new sessions."""

import pytest

from bus.history import ordering
from bus.history.key_state import Fetch
from tests.bus.history.receiving import HERE, KEY, OURS, Received, message

NEXT = f"{KEY}/@adv/pub/next/1/_"


def test_who_was_cut_off_gets_what_it_has_not_got_yet() -> None:
    got = Received()
    got.appear()
    got.live(0, 1)
    got.history.cut_off()
    got.appear(kept=None)
    got.history.all_appeared()
    got.live(5)
    got.answer(2, 3, 4)
    assert got.fetches[1:] == [Fetch(KEY, HERE, ((OURS, 1),))]
    assert got.outcome == ([0, 1, 2, 3, 4, 5], 0)


def test_who_was_cut_off_gets_the_last_where_that_is_enough() -> None:
    got = Received(recover=1)
    got.appear()
    got.live(0, 1)
    got.history.cut_off()
    got.appear(kept=[4])
    got.live(4, 5)
    assert got.outcome == ([0, 1, 4, 5], 2)


@pytest.mark.parametrize("seen_to_leave", [True, False])
def test_who_is_cut_off_while_a_cache_is_asked_asks_it_again(*, seen_to_leave: bool) -> None:
    got = Received()
    got.appear(kept=[0])
    got.live(3)
    if seen_to_leave:  # which comes before the link's own end
        got.history.leave(KEY, HERE)
    got.history.cut_off()
    got.answer(1)  # too late
    got.appear(kept=None)
    got.history.all_appeared()
    got.live(5)
    got.answer(1, 2, 3, 4)
    assert got.fetches[1:] == [Fetch(KEY, HERE, ((OURS, 0),))] * 2
    assert got.outcome == ([0, 1, 2, 3, 4, 5], 0)


def test_what_waits_for_a_publisher_that_does_not_come_back_is_not_lost() -> None:
    got = Received()
    got.appear(kept=[0])
    got.live(3)
    got.history.cut_off()
    assert got.messages == [0]
    got.history.all_appeared()
    assert got.outcome == ([0, 3], 2)
    got.live(4)
    assert got.messages == [0, 3, 4]


def test_who_leaves_and_is_there_again_while_its_cache_is_asked_is_asked_once_more() -> None:
    got = Received()
    got.appear(kept=None)
    got.history.leave(KEY, HERE)
    got.appear(kept=[])  # this is the first one's end
    assert len(got.fetches) == 2
    got.live(3)
    got.answer(1, 2)
    assert got.outcome == ([1, 2, 3], 0)


def test_all_caches_of_a_key_are_waited_for() -> None:
    got = Received()
    got.history.appear(KEY, HERE)
    got.history.appear(KEY, NEXT)
    got.live(3)
    got.answer(2)
    assert got.messages == []
    got.history.fetched(got.fetches[0])
    assert got.outcome == ([2, 3], 0)


def test_a_cache_answers_for_its_own_key() -> None:
    got = Received()
    got.history.appear(KEY, HERE)
    got.history.kept(got.fetches[0], message(5, key="fleet/r2/front/classes"))
    got.answer(1)
    assert got.outcome == ([1], 0)


def test_a_cache_that_takes_long_does_not_hold_up_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ordering, "MOST_HELD", 3)
    got = Received(recover=2)
    got.appear(kept=None)
    got.live(10, 11, 12, 13, 14)
    assert got.messages == [10, 11, 12, 13, 14]
    got.live(15)
    got.answer(9)
    assert got.outcome == ([10, 11, 12, 13, 14, 15], 0)


def test_what_a_publisher_takes_to_its_next_session_comes_once() -> None:
    got = Received()
    got.appear()
    got.live(0, 1)
    got.history.leave(KEY, HERE)
    got.appear(NEXT, kept=None)
    got.live(3)
    got.answer(0, 1, 2)
    got.live(4)
    assert got.outcome == ([0, 1, 2, 3, 4], 0)


def test_what_was_lost_between_two_sessions_is_missed_once() -> None:
    got = Received()
    got.appear()
    got.live(0, 1)
    got.history.leave(KEY, HERE)
    got.appear(NEXT, kept=None)
    got.live(6)
    got.answer(4, 5)
    assert got.messages == [0, 1], "the next ones may have been sent meanwhile: it is asked once more"
    got.answer(4, 5, 6)
    assert got.outcome == ([0, 1, 4, 5, 6], 2)


def test_not_every_key_whose_publishers_left_is_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ordering, "KEYS_REMEMBERED", 2)
    got = Received()
    keys = [f"fleet/r{number}/front/classes" for number in range(3)]
    for key in keys:
        got.history.appear(key, f"{key}/@adv/pub/session/1/_")
        got.history.live([message(0, key=key)])
        got.history.fetched(got.fetches[-1])
    got.history.cut_off()
    got.live(0, key=keys[0])  # all are still known: who is there is not
    assert got.messages == [0, 0, 0]
    got.history.all_appeared()
    got.live(0, key=keys[2])
    got.live(0, key=keys[0])
    assert got.messages == [0, 0, 0, 0]


def test_what_waits_under_a_key_that_is_forgotten_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ordering, "KEYS_REMEMBERED", 1)
    got = Received()
    got.appear(kept=None)
    got.live(3)
    got.history.cut_off()
    got.live(8, 9, key="fleet/r2/front/classes")
    assert got.messages == [3]
