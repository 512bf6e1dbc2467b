"""What a gateway sends when its consumers say how much they can use."""

import pytest

from gateway.to_bus.shaping.consumers import MAX_BUDGETS, Budgets
from schemas.budget import RateBudget
from schemas.consumer_keys import Wanted
from schemas.errors import SchemaError
from schemas.keys import CameraKey, Stream, StreamKey

FRONT = CameraKey("r1", "front")
COLOR = StreamKey(FRONT, Stream.COLOR)
A, B = (Wanted(COLOR, "clock", name) for name in "ab")
MS = 1_000_000
START = 1_700_000_000_000 * MS


def budget(hz: float | None, wait_s: float = 0.0, consumer: str = "a", stream: str = "color") -> RateBudget:
    return RateBudget(robot="r1", camera="front", consumer=consumer, stream=stream, hz=hz, wait_s=wait_s)


def sent(budgets: Budgets, *consumers: Wanted, hz: int = 10, seconds: int = 10, start: int = START) -> list[int]:
    """Return at what milliseconds a camera's frames are sent."""
    times = (n * 1000 // hz for n in range(seconds * hz))
    return [at for at in times if budgets.passes(COLOR, consumers, start + at * MS)]


def told(*said: RateBudget) -> Budgets:
    made = Budgets()
    for each in said:
        made.say(FRONT, each, START)
    return made


def test_who_says_nothing_is_sent_everything() -> None:
    assert len(sent(Budgets())) == len(sent(Budgets(), A)) == len(sent(told(budget(2)), A, B)) == 100


def test_no_more_than_can_be_used() -> None:
    assert sent(told(budget(2)), A)[:4] == [0, 500, 1000, 1500]
    assert len(sent(told(budget(3)), A)) == 30
    assert len(sent(told(budget(2.5)), A)) == 25
    assert len(sent(told(budget(20)), A)) == 100


def test_the_largest_rate_counts_and_not_the_sum() -> None:
    assert len(sent(told(budget(2), budget(5, consumer="b")), A, B)) == 50
    assert len(sent(told(budget(2), budget(None, consumer="b")), A, B)) == 100


def test_a_budget_counts_only_while_its_consumer_wants_the_stream() -> None:
    made = told(budget(2), budget(5, consumer="b"))
    assert len(sent(made, A)) == 20
    made.forget(A)
    assert len(sent(made, A)) == 100


def test_a_word_that_is_said_again_puts_no_frame_forward() -> None:
    made = told(budget(2))
    assert made.passes(COLOR, [A], START)
    made.say(FRONT, budget(2), START + 100 * MS)
    assert sent(made, A)[:2] == [500, 1000]
    made.say(FRONT, budget(2, wait_s=1.0), START + 10_000 * MS)
    assert sent(made, A, start=START + 10_000 * MS)[:2] == [1000, 1500]


def test_the_newest_word_counts_and_says_when_the_next_frame_is_wanted() -> None:
    made = told(budget(2), budget(5, wait_s=0.31))
    assert sent(made, A)[:3] == [400, 600, 800]


def test_a_budget_is_for_one_stream() -> None:
    assert len(sent(told(budget(2, stream="depth")), A)) == 100


def test_a_camera_that_paused_is_owed_nothing() -> None:
    made = told(budget(2))
    sent(made, A)
    made.say(FRONT, budget(2), START + 3_600_000 * MS)
    assert sent(made, A, start=START + 3_600_000 * MS)[:3] == [0, 500, 1000]


def test_a_clock_that_is_set_back_stops_nothing() -> None:
    made = told(budget(2))
    sent(made, A)
    made.say(FRONT, budget(2), START - 3_600_000 * MS)
    assert sent(made, A, start=START - 3_600_000 * MS)[:3] == [0, 500, 1000]


@pytest.mark.parametrize(
    "wrong",
    [
        RateBudget(robot="r2", camera="front", consumer="a", stream="color", hz=1),
        RateBudget(robot="r1", camera="rear", consumer="a", stream="color", hz=1),
        RateBudget(robot="r1", camera="front", consumer="a", stream="colour", hz=1),
    ],
)
def test_a_word_on_something_else_is_refused(wrong: RateBudget) -> None:
    with pytest.raises(SchemaError):
        Budgets().say(FRONT, wrong, START)


def test_what_is_remembered_is_bounded_and_the_newest_word_is() -> None:
    made = told(*(budget(1, consumer=f"c{number}") for number in range(MAX_BUDGETS)))
    made.say(FRONT, budget(1, consumer="c0"), START)
    made.say(FRONT, budget(1, consumer="new"), START)
    kept, forgotten, newest = (Wanted(COLOR, "clock", name) for name in ("c0", "c1", "new"))
    assert [len(sent(made, each)) for each in (kept, forgotten, newest)] == [10, 100, 10]
