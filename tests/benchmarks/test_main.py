import json
from pathlib import Path

import pytest

from benchmarks.__main__ import main

STAND_INS = Path(__file__).parent / "stand_ins"


def ran(*arguments: str, results: Path) -> int:
    with pytest.raises(SystemExit) as left:
        main([*arguments, "--results", str(results)], package="tests.benchmarks.stand_ins", folder=STAND_INS)
    assert isinstance(left.value.code, int)
    return left.value.code


def test_a_file_of_each_and_one_that_fails_does_not_stop_the_rest(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    results = tmp_path / "new" / "results"
    assert ran("wrong", "quick", "--repeat", "2", results=results) == 1
    printed = capfd.readouterr()
    assert printed.out.splitlines() == [
        "failed: wrong: exit code 1: looking | cannot go on",
        f"1 of 2 benchmarks done, in {results}",
    ]
    assert printed.err.splitlines() == [
        "[1/2] wrong",
        "  wrong: run 1 of 2",
        "  wrong: looking",
        "  wrong: cannot go on",
        "  wrong: failed: exit code 1: looking | cannot go on",
        "[2/2] quick",
        "  quick: run 1 of 2",
        "  quick: nearly there",
        "  quick: run 2 of 2",
        "  quick: nearly there",
        "  quick: 1 of 1 targets met",
    ]
    assert [path.name for path in results.iterdir()] == ["quick.json"]
    kept = json.loads((results / "quick.json").read_text())
    assert kept["command"] == "python -m tests.benchmarks.stand_ins.quick --json"
    assert (kept["benchmark"], kept["runs"], kept["seeds"], kept["figures"]) == ("quick", 2, [1, 2], {"speed": 3.0})
    assert kept["targets"] == {"speed": {"value": 3.0, "at_least": 2, "met": True, "runs_met": 2}}


def test_all_is_well(tmp_path: Path) -> None:
    assert ran("quick", results=tmp_path) == 0


def test_one_that_takes_too_long_fails(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert ran("late", "--limit-s", "0.01", results=tmp_path) == 1
    assert "failed: late: not done after 0.01 s" in capfd.readouterr().out


def test_an_unknown_one_is_refused_before_anything_runs(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert ran("quick", "slow", results=tmp_path) == 2
    assert "no benchmark is called 'slow'; there are garbled, late, quick, wrong" in capfd.readouterr().err
    assert not list(tmp_path.iterdir())


def test_our_own_are_found(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["--help"])
    assert left.value.code == 0
    assert "gateway, scaling" in capfd.readouterr().out.replace("\n", " ")
