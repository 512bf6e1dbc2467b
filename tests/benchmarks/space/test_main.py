import json
from pathlib import Path

import pytest

from benchmarks.space.__main__ import main
from benchmarks.space.report import TARGETS

ONE_OF_EACH = ["--frames", "2", "--rounds", "1", "--crowded", "1", "--seconds", "0"]


def test_one_object_on_standard_output_and_progress_elsewhere(capfd: pytest.CaptureFixture[str]) -> None:
    main(["--json", "--views", "3", "--drives", "1", *ONE_OF_EACH])
    printed = capfd.readouterr()
    found = json.loads(printed.out)
    assert TARGETS.keys() <= found.keys()
    assert found["seeds"]["views"] == [1_700_000, 1_700_000]
    assert found["spread"]["distance_gt_masks"]["objects"] > 0
    assert {"machine", "versions", "targets"} <= found.keys()
    assert [(found[name]["views"], found[name]["drives"]) for name in ("size", "asked")] == [(1, 1), (3, 1)]
    assert printed.err.splitlines() == ["no time for more than 1 of 3", "drives 1/1", "times"]


def test_bad_weights_are_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "garbage.pt").write_bytes(b"nothing of the kind")
    with pytest.raises(SystemExit) as left:
        main(["--weights", str(tmp_path / "garbage.pt")])
    printed = capfd.readouterr()
    assert (left.value.code, printed.out) == (2, "")
    (line,) = printed.err.splitlines()
    assert line.startswith("python -m benchmarks.space: ")
    assert "not a model that can be used" in line
