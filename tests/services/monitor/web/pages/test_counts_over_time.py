from services.monitor.history.counting import Counts, Slots
from services.monitor.web.pages.chart import MAX_LINES, counts_over_time

S = 1_000_000_000
SLOTS = Slots(100 * S, 150 * S, 10 * S)


def test_a_count_lasts_until_the_next_and_the_last_until_the_end() -> None:
    lines = counts_over_time(Counts(SLOTS, {"box": {0: 1, 1: 1, 2: 3}}, {0, 1, 2, 3, 4}))
    assert lines == {"box": [(100_000, 1), (120_000, 3), (130_000, 0), (150_000, 0)]}


def test_where_nobody_knows_there_is_a_gap() -> None:
    lines = counts_over_time(Counts(SLOTS, {"box": {1: 2, 4: 2}}, {1, 2, 4}))
    assert lines == {"box": [(100_000, None), (110_000, 2), (120_000, 0), (130_000, None), (140_000, 2), (150_000, 2)]}


def test_the_classes_with_the_most_are_shown() -> None:
    most = {f"c{count}": {0: count} for count in range(1, MAX_LINES + 3)}
    lines = counts_over_time(Counts(SLOTS, most, {0}))
    assert list(lines) == [f"c{count}" for count in range(MAX_LINES + 2, 2, -1)]
