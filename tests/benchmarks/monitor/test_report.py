from math import inf

import pytest

from benchmarks.monitor.report import Flow, percentile, targets


@pytest.mark.parametrize(("percent", "value"), [(50, 50.0), (99, 99.0), (1, 1.0)])
def test_a_percentile_is_one_of_the_values(percent: int, value: float) -> None:
    assert percentile([float(number) for number in range(100, 0, -1)], percent) == value
    assert percentile([7.0], percent) == 7.0


def test_the_slowest_path_counts_and_an_answer_that_is_an_error_is_never_there() -> None:
    pages = {"/": [1.0] * 19 + [2.0], "/api": [3.0] * 18 + [inf] * 2}
    figures = Flow(0, 1999.6, [1.0, 2.0], pages, 0.25, 3.0).figures()
    assert (figures["page_p95_ms"], figures["p95_ms_by_path"]) == (inf, {"/": 1.0, "/api": inf})
    assert (figures["p50_ms"], figures["p99_ms"], figures["msgs_per_s"]) == (1.0, 2.0, 2000)


@pytest.mark.parametrize(("share", "met"), [(0.35, True), (0.36, False)])
def test_targets_are_limits(share: float, *, met: bool) -> None:
    found = {"lost": 0, "p99_ms": 50.0, "rss_mb": 601, "page_p95_ms": inf, "cpu_share_1000x5": share}
    made = targets(found)
    assert [made[name]["met"] for name in found] == [True, True, False, False, met]
