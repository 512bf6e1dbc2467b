from pathlib import Path

import pytest

from benchmarks.running.finding import UnknownBenchmarkError, chosen, names_in


def test_packages_that_can_be_run_are_benchmarks(tmp_path: Path) -> None:
    for name in ("scaling", "gateway", "peers"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").touch()
    for name in ("scaling", "gateway"):
        (tmp_path / name / "__main__.py").touch()
    (tmp_path / "__main__.py").touch()
    (tmp_path / "plots.py").touch()
    assert names_in(tmp_path) == ["gateway", "scaling"]


def test_what_is_asked_for_runs_once_and_in_that_order() -> None:
    assert chosen(["c", "a", "c"], ["a", "b", "c"]) == ["c", "a"]
    assert chosen([], ["a", "b"]) == ["a", "b"]


def test_an_unknown_benchmark_is_named_beside_those_there_are() -> None:
    with pytest.raises(UnknownBenchmarkError, match="'x'; there are a, b"):
        chosen(["a", "x"], ["a", "b"])
