from typing import Any

import pytest

from benchmarks.running.record import Run, merged, middle, record, targets


def found(speed: float, *, met: bool, ratio: float | None = 2.0) -> dict[str, Any]:
    return {
        "targets": {
            "speed": {"value": speed, "at_least": 2, "met": met},
            "age / other": {"ratio": ratio, "at_most": 2, "met": ratio is not None},
        },
        "speed": speed,
        "spread": {"speed": [speed - 1, speed + 1]},
        "machine": {"cores": 2},
        "versions": {"numpy": "2"},
        "seeds": [1, 5],
    }


def kept(*runs: Run) -> dict[str, Any]:
    return record("speed", "python -m benchmarks.speed --json", "2026-01-02T03:04:05+00:00", "abc", runs)


def test_one_run_is_kept_as_it_is() -> None:
    assert kept(Run(found(3, met=True), 1.23, 0.5)) == {
        "benchmark": "speed",
        "command": "python -m benchmarks.speed --json",
        "date": "2026-01-02T03:04:05+00:00",
        "commit": "abc",
        "machine": {"cores": 2},
        "versions": {"numpy": "2"},
        "seeds": [1, 5],
        "runs": 1,
        "seconds": 1.2,
        "load_average_before": 0.5,
        "targets": {
            "speed": {"value": 3, "at_least": 2, "met": True, "runs_met": 1},
            "age / other": {"ratio": 2.0, "at_most": 2, "met": True, "runs_met": 1},
        },
        "figures": {"speed": 3, "spread": {"speed": [2, 4]}},
    }


def test_of_several_runs_there_are_least_median_and_greatest() -> None:
    three = kept(
        Run(found(1, met=False), 1, 0), Run(found(4, met=True), 2, 0), Run(found(2, met=True, ratio=1.5), 4, 0)
    )
    spread = {"min": 1, "median": 2, "max": 4}
    assert (three["runs"], three["seconds"], three["figures"]["speed"]) == (3, spread, spread)
    assert three["figures"]["spread"]["speed"] == [{"min": 0, "median": 1, "max": 3}, {"min": 2, "median": 3, "max": 5}]
    assert three["targets"]["speed"] == {"value": spread, "at_least": 2, "met": True, "runs_met": 2}
    assert three["targets"]["age / other"]["ratio"] == {"min": 1.5, "median": 2.0, "max": 2.0}
    assert three["seeds"] == [1, 5]


@pytest.mark.parametrize(("speeds", "met"), [((1.9, 2.0, 9.0), True), ((1.8, 1.9, 9.0), False)])
def test_the_median_meets_a_target(speeds: tuple[float, ...], *, met: bool) -> None:
    (speed,) = targets([{"speed": found(speed, met=speed >= 2)["targets"]["speed"]} for speed in speeds]).values()
    assert speed["met"] is met


def test_what_could_not_be_measured_once_meets_no_target() -> None:
    both = targets([found(3, met=True)["targets"], found(3, met=True, ratio=None)["targets"]])
    assert both["age / other"] == {"ratio": [2.0, None], "at_most": 2, "met": False, "runs_met": 1}


@pytest.mark.parametrize(
    ("values", "together"),
    [
        ([1, 1.0], 1),
        ([True, False], [True, False]),
        (["a", "b"], ["a", "b"]),
        ([None, 2], [None, 2]),
        ([[1], [1, 2]], [[1], [1, 2]]),
        ([{"a": 1}, {"a": 3, "b": 2}], {"a": {"min": 1, "median": 2, "max": 3}, "b": 2}),
        ([0.1, 0.2], {"min": 0.1, "median": 0.15, "max": 0.2}),
    ],
)
def test_values_of_all_kinds_are_merged(values: list[Any], together: Any) -> None:
    assert merged(values) == together


def test_a_figure_has_a_median_whether_it_differs_or_not() -> None:
    assert middle(3) == middle({"min": 1, "median": 3, "max": 4}) == 3.0


@pytest.mark.parametrize("value", [None, "fast", True, [1], {"p50": 1}])
def test_what_is_no_figure_has_none(value: Any) -> None:
    with pytest.raises(ValueError, match="no figure"):
        middle(value)
