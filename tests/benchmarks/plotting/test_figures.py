from typing import Any

import pytest

from benchmarks.plotting.figures import Bar, Figures, NoFigureError

FOUND = Figures(
    {
        "benchmark": "speed",
        "date": "2026-01-02T03:04:05+00:00",
        "machine": {"cpu": "A Processor", "cores": 2},
        "targets": {"fast": {"at_least": 2}, "age / other": {"at_most": 0.3}},
        "figures": {
            "fast": 3,
            "alone": 4,
            "often": {"min": 1, "median": 2.5, "max": 9},
            "name": "torch",
            "hops": [{"hop": "model", "ms": 2}, {"hop": "link", "ms": None}],
            "spread": {"fast": [2, 5], "often": [0, 99], "deep": {"p50": 0.5}},
        },
    }
)


def test_a_figure_has_the_spread_of_its_run_or_of_all_runs() -> None:
    assert FOUND.bar("fast") == Bar(3, 2, 5)
    assert FOUND.bar("alone") == Bar(4, 4, 4)
    assert FOUND.bar("often") == Bar(2.5, 1, 9)
    assert FOUND.value("spread", "deep", "p50") == 0.5


def test_the_rows_of_a_table() -> None:
    assert [(row.text("hop"), row.has("ms")) for row in FOUND.table("hops")] == [("model", True), ("link", False)]
    assert FOUND.table("hops")[0].bar("ms") == Bar(2, 2, 2)
    with pytest.raises(NoFigureError, match="speed: fast: no table"):
        FOUND.table("fast")


def test_limits_of_both_kinds() -> None:
    assert (FOUND.limit("fast"), FOUND.limit("age / other")) == (2, 0.3)


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        (("slow",), r"speed: slow: no such figure"),
        (("fast", "p50"), r"speed: fast\.p50: no such figure"),
        (("name",), r"speed: name: no figure: torch"),
        (("spread", "deep"), r"speed: spread\.deep: no figure"),
    ],
)
def test_what_is_missing_is_named(path: tuple[str, ...], reason: str) -> None:
    with pytest.raises(NoFigureError, match=reason):
        FOUND.bar(*path)
    with pytest.raises(NoFigureError, match="speed: slow: no such target"):
        FOUND.limit("slow")


@pytest.mark.parametrize(
    ("record", "source"),
    [(FOUND.record, "2 cores, A Processor, 2026-01-02"), ({}, "? cores, unknown processor, ")],
)
def test_a_picture_says_where_it_is_from(record: dict[str, Any], source: str) -> None:
    assert Figures(record).source() == source
