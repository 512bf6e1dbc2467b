from hypothesis import given
from hypothesis import strategies as st

from schemas.keys import CameraKey
from services.monitor.history.intervals import Interval
from services.monitor.page.counts_over_time import BUCKETS, MAX_LINES, counts_over_time

S = 1_000_000_000


def interval(begin_s: int, end_s: int, *, name: str = "box", count: int = 1, going_on: bool = False) -> Interval:
    return Interval(
        key=CameraKey("r1", "front"),
        name=name,
        since_ns=begin_s * S,
        until_ns=end_s * S,
        open=going_on,
        count=count,
        score=0.5,
        closest_m=None,
        first_ns=0,
        model="m",
        worker="w",
    )


def test_cameras_add_up() -> None:
    lines = counts_over_time([interval(100, 500), interval(200, 300, count=2)], 0, 1_000 * S)
    assert lines == {"box": [(0, 0), (100_000, 1), (200_000, 3), (300_000, 1), (500_000, 0), (1_000_000, 0)]}


def test_what_began_before_is_there_from_the_beginning_and_what_goes_on_is_there_at_the_end() -> None:
    lines = counts_over_time([interval(0, 950, going_on=True)], 500 * S, 1_000 * S)
    assert lines == {"box": [(500_000, 0), (500_000, 1), (1_000_000, 1)]}


def test_one_count_follows_another_without_a_gap() -> None:
    lines = counts_over_time([interval(100, 200), interval(200, 300, count=2)], 0, 1_000 * S)
    assert (200_000, 2) in lines["box"]
    assert max(count for _, count in lines["box"]) == 2


def test_what_was_at_another_time_is_left_out() -> None:
    assert counts_over_time([interval(0, 100), interval(900, 950), interval(300, 300)], 200 * S, 800 * S) == {}


def test_the_classes_with_the_most_are_shown() -> None:
    many = [interval(100, 200, name=f"c{count}", count=count) for count in range(1, MAX_LINES + 3)]
    lines = counts_over_time(many, 0, 1_000 * S)
    assert list(lines) == [f"c{count}" for count in range(MAX_LINES + 2, 2, -1)]


@given(st.lists(st.tuples(st.integers(0, 10_000), st.integers(1, 3_000), st.integers(1, 5)), max_size=1_000))
def test_a_line_is_short_in_order_and_keeps_its_most(made: list[tuple[int, int, int]]) -> None:
    found = [interval(begin, begin + length, count=count) for begin, length, count in made]
    points = counts_over_time(found, 0, 10_000 * S).get("box", [])
    assert len(points) <= 2 * (BUCKETS + 2) + 1
    assert [at for at, _ in points] == sorted(at for at, _ in points)
    ends = sorted({end for begin, length, _ in made for end in (begin, begin + length)})
    sums = [sum(count for begin, length, count in made if begin <= at < begin + length) for at in ends if at < 10_000]
    assert max((count for _, count in points), default=0) == max(sums, default=0)
