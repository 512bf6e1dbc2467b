"""The order of what publishers sent, whatever way it comes."""

from collections.abc import Iterable

import pytest

from bus.history import ordering
from bus.history.ordering import Fetch, History, Numbered

KEY = "fleet/r1/front/classes"
HERE = f"{KEY}/@adv/pub/session/1/_"
NEXT = f"{KEY}/@adv/pub/next/1/_"
OURS = 7


def message(number: int, newness: int = 0, publisher: int = OURS, key: str = KEY) -> Numbered[int]:
    return Numbered(key, publisher, number, number, newness, f"place of {number}")


class Received:
    """A history, and what became of what it was given. Messages are their numbers."""

    def __init__(self, recover: int = 9) -> None:
        self.messages: list[int] = []
        self.missed = 0
        self.fetches: list[Fetch] = []
        self.doubts: list[Fetch] = []
        self.history: History[int] = History(
            recover, self.fetches.append, self.doubts.append, self.messages.extend, self._miss
        )

    def _miss(self, number: int) -> None:
        self.missed += number

    @property
    def outcome(self) -> tuple[list[int], int]:
        return self.messages, self.missed

    def appear(self, cache: str = HERE, kept: Iterable[int] | None = ()) -> None:
        """Have a publisher come whose cache has these, or does not answer yet."""
        self.history.appear(KEY, cache)
        if kept is not None:
            self.answer(*kept)

    def answer(self, *kept: int) -> None:
        """Have the cache that was asked last answer."""
        for number in kept:
            self.history.kept(self.fetches[-1], message(number))
        self.history.fetched(self.fetches[-1])

    def nothing(self) -> None:
        """Have the cache that was asked last have nothing, or not be reached."""
        self.history.fetched(self.fetches[-1], empty=True)

    def ask_again(self) -> None:
        self.history.ask_again(self.doubts[-1])

    def live(self, *numbers: int, publisher: int = OURS, key: str = KEY) -> None:
        self.history.live(message(number, publisher=publisher, key=key) for number in numbers)

    def again(self, *numbers: int) -> None:
        """Have a publisher put on a new session what it keeps."""
        self.history.live(message(number, newness=len(numbers) - index) for index, number in enumerate(numbers))


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
    assert got.fetches[-1] == Fetch(KEY, HERE, ("place of 2",))
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
    monkeypatch.setattr(ordering, "PUBLISHERS_REMEMBERED", 2)
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
    assert got.fetches[1:] == [Fetch(KEY, HERE, ("place of 1",))]
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


def test_who_was_cut_off_gets_what_it_has_not_got_yet() -> None:
    got = Received()
    got.appear()
    got.live(0, 1)
    got.history.cut_off()
    got.appear(kept=None)
    got.history.all_appeared()
    got.live(5)
    got.answer(2, 3, 4)
    assert got.fetches[1:] == [Fetch(KEY, HERE, ("place of 1",))]
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
    assert got.fetches[1:] == [Fetch(KEY, HERE, ("place of 0",))] * 2
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
    got.again(0, 1, 2)
    got.live(3)
    got.answer(0, 1, 2)
    got.live(4)
    assert got.outcome == ([0, 1, 2, 3, 4], 0)


def test_what_was_lost_between_two_sessions_is_missed_once() -> None:
    got = Received()
    got.appear()
    got.live(0, 1)
    got.again(4, 5)
    got.live(6)
    got.answer(4, 5)
    assert got.outcome == ([0, 1, 4, 5, 6], 2)


@pytest.mark.parametrize("asked_at_its_end", [True, False])
def test_of_what_is_taken_along_no_more_comes_than_is_wanted(*, asked_at_its_end: bool) -> None:
    got = Received(recover=2)
    got.appear(NEXT, kept=None if asked_at_its_end else [])
    got.again(0, 1, 2, 3)
    if asked_at_its_end:
        got.answer()
    assert got.outcome == ([2, 3], 0)


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
