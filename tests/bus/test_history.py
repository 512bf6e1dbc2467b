"""The order of what publishers sent, whatever way it comes."""

from collections.abc import Iterable

import pytest

from bus import history
from bus.history import Fetch, History, Numbered

HERE = "session/1"
CACHE = "fleet/r1/front/classes/@adv/pub/session/1/_"


class Received:
    """A history, and what became of what it was given. Messages are their numbers."""

    def __init__(self, recover: int = 9) -> None:
        self.messages: list[int] = []
        self.missed = 0
        self.fetches: list[Fetch] = []
        self.history: History[int] = History(recover, self.fetches.append, self.messages.extend, self._miss)

    def _miss(self, number: int) -> None:
        self.missed += number

    def appear(self, source: str = HERE, kept: Iterable[int] = ()) -> None:
        """Have a publisher come whose cache has these."""
        self.history.appear(source, CACHE)
        self.answer(kept, source)

    def answer(self, kept: Iterable[int], source: str = HERE) -> None:
        for number in kept:
            self.history.kept(Numbered(source, number, number))
        self.history.fetched(source)

    def live(self, *numbers: int, source: str = HERE) -> None:
        self.history.live(Numbered(source, number, number) for number in numbers)

    def taken_along(self, *numbers: int, source: str, origin: str = HERE) -> None:
        """Have a publisher put again on a session what it sent on another one, there numbered from 0."""
        self.history.live(
            Numbered(source, number, message, (origin, message)) for number, message in enumerate(numbers)
        )


def test_what_is_kept_comes_first_and_once() -> None:
    got = Received()
    got.history.appear(HERE, CACHE)
    got.live(3, 4)
    assert got.messages == []
    got.answer([1, 2, 3])
    got.live(5)
    assert got.messages == [1, 2, 3, 4, 5]
    assert got.fetches == [Fetch(CACHE, HERE, None)]
    assert got.missed == 0


def test_publishers_do_not_wait_for_each_other() -> None:
    got = Received()
    got.history.appear(HERE, CACHE)
    got.live(7, source="other/1")
    assert got.messages == [7]


def test_who_has_no_cache_is_not_waited_for() -> None:
    got = Received()
    got.live(5, 6, 9)
    assert (got.messages, got.missed, got.fetches) == ([5, 6, 9], 2, [])


def test_no_more_is_taken_of_a_cache_than_is_wanted() -> None:
    got = Received(recover=2)
    got.history.appear(HERE, CACHE)
    got.live(4)
    got.answer([0, 1, 2, 3])
    assert (got.messages, got.missed) == ([2, 3, 4], 0)


def test_a_hole_is_filled_where_more_than_the_last_is_wanted() -> None:
    got = Received()
    got.appear()
    got.live(0, 1, 4, 5)
    assert got.messages == [0, 1]
    assert got.fetches[1:] == [Fetch(CACHE, HERE, 1)]
    got.answer([2, 3, 4, 5])
    assert (got.messages, got.missed) == ([0, 1, 2, 3, 4, 5], 0)


def test_what_no_cache_has_any_more_is_missed() -> None:
    got = Received()
    got.appear()
    got.live(0, 5)
    got.answer([4, 5])
    assert (got.messages, got.missed) == ([0, 4, 5], 3)


def test_a_hole_is_only_counted_where_the_last_is_enough() -> None:
    got = Received(recover=1)
    got.appear()
    got.live(0, 3)
    assert (got.messages, got.missed, len(got.fetches)) == ([0, 3], 2, 1)


def test_old_and_doubled_ones_are_left_out() -> None:
    got = Received()
    got.appear()
    got.live(0, 1, 1, 0, 2)
    assert (got.messages, got.missed) == ([0, 1, 2], 0)


def test_numbers_start_anew_at_their_end() -> None:
    got = Received()
    got.appear()
    got.live(2**32 - 2, 2**32 - 1, 0, 1)
    assert (got.messages, got.missed) == ([2**32 - 2, 2**32 - 1, 0, 1], 0)


def test_who_was_cut_off_gets_what_it_has_not_got_yet() -> None:
    got = Received()
    got.appear()
    got.live(0, 1)
    got.history.cut_off()
    got.history.appear(HERE, CACHE)
    got.live(5)
    got.answer([2, 3, 4])
    assert got.fetches[1:] == [Fetch(CACHE, HERE, 1)]
    assert (got.messages, got.missed) == ([0, 1, 2, 3, 4, 5], 0)


@pytest.mark.parametrize("seen_to_leave", [True, False])
def test_who_is_cut_off_while_a_cache_is_asked_asks_it_again(*, seen_to_leave: bool) -> None:
    got = Received()
    got.appear(kept=[0])
    got.live(3)
    if seen_to_leave:  # which comes before the link's own end
        got.history.leave(HERE)
    got.history.cut_off()
    got.history.kept(Numbered(HERE, 1, 1))
    got.history.appear(HERE, CACHE)
    got.live(5)
    got.answer([1, 2, 3, 4])
    assert got.fetches[1:] == [Fetch(CACHE, HERE, 0), Fetch(CACHE, HERE, 0)]
    assert (got.messages, got.missed) == ([0, 1, 2, 3, 4, 5], 0)


def test_a_cache_that_takes_long_does_not_hold_up_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "MOST_HELD", 3)
    got = Received(recover=1)
    got.history.appear(HERE, CACHE)
    got.live(10, 11, 12, 13)
    assert got.messages == [10, 11, 12, 13]
    got.live(14)
    got.answer([9])
    assert (got.messages, got.missed) == ([10, 11, 12, 13, 14], 0)


def test_what_a_publisher_takes_to_its_next_session_comes_once() -> None:
    got = Received()
    got.appear()
    got.live(0, 1)
    got.history.leave(HERE)
    got.history.appear("next/1", CACHE)
    got.taken_along(0, 1, 2, source="next/1")
    got.live(3, source="next/1")
    got.history.fetched("next/1")
    got.live(4, source="next/1")
    assert (got.messages, got.missed) == ([0, 1, 2, 3, 4], 0)


def test_it_comes_once_after_two_sessions_too_to_who_was_not_there_for_the_first() -> None:
    got = Received()
    got.history.appear("next/1", CACHE)
    got.taken_along(0, 1, source="next/1")
    got.history.fetched("next/1")
    got.history.leave("next/1")
    got.history.appear("last/1", CACHE)
    got.taken_along(0, 1, source="last/1")
    got.history.fetched("last/1")
    assert (got.messages, got.missed) == ([0, 1], 0)


def test_what_was_lost_between_two_sessions_is_missed() -> None:
    got = Received()
    got.appear()
    got.live(0, 1)
    got.taken_along(4, 5, source="next/1")
    assert (got.messages, got.missed) == ([0, 1, 4, 5], 2)


def test_what_is_held_of_a_session_comes_before_what_was_taken_to_the_next() -> None:
    got = Received()
    got.history.appear(HERE, CACHE)
    got.live(5, 6, 7)
    got.history.appear("next/1", CACHE)
    got.taken_along(7, 8, source="next/1")
    got.history.fetched("next/1")
    got.history.fetched(HERE)
    assert (got.messages, got.missed) == ([5, 6, 7, 8], 0)


def test_who_claims_to_go_on_for_another_does_not_silence_it() -> None:
    got = Received()
    got.appear()
    got.live(0)
    got.taken_along(9, source="other/1")
    got.live(1)
    assert got.messages == [0, 9, 1]


def test_of_what_is_taken_along_no_more_comes_than_is_wanted() -> None:
    got = Received(recover=1)
    got.history.appear("next/1", CACHE)
    got.taken_along(0, 1, 2, source="next/1")
    got.history.fetched("next/1")
    assert (got.messages, got.missed) == ([2], 0)


def test_not_everybody_who_left_is_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "GONE_REMEMBERED", 2)
    got = Received()
    for name in ("a/1", "b/1", "c/1"):
        got.appear(name)
        got.live(0, source=name)
        got.history.leave(name)
    got.live(0, source="a/1")
    got.live(0, source="c/1")
    assert got.messages == [0, 0, 0, 0]
