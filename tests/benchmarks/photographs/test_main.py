import json
from pathlib import Path

import pytest

from benchmarks.photographs.__main__ import main, targets
from benchmarks.photographs.stand_ins import PICTURES, write_stand_ins


def printed(capfd: pytest.CaptureFixture[str], *options: str) -> dict[str, object]:
    main(["--json", *options])
    found: dict[str, object] = json.loads(capfd.readouterr().out)
    return found


def test_one_object_with_and_without_a_folder(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    without = printed(capfd)
    given = printed(capfd, "--folder", str(write_stand_ins(tmp_path)))
    assert (without["photographs"], given["photographs"]) == (False, True)
    for found in (without, given):
        assert found["pictures"] == PICTURES
        assert found["per_source"].keys() == {"rendered"}  # type: ignore[attr-defined]
        assert found["recall"]["box"] > 0.3  # type: ignore[index]
        assert {"machine", "versions", "weights", "confidence"} <= found.keys()
    assert without["targets"] == {}
    assert {"recall_box", "precision_box"} <= given["targets"].keys()  # type: ignore[attr-defined]


def test_nothing_is_asked_of_what_nobody_labelled() -> None:
    found = {
        "recall": {"forklift": 0.8},
        "precision": {"forklift": 0.5},
        "labelled": {"forklift": 3},
        "empty_pictures": 0,
        "false_alarms_per_empty_picture": None,
    }
    assert {name: each["met"] for name, each in targets(found).items()} == {
        "recall_forklift": True,
        "precision_forklift": False,
    }


def test_a_folder_without_photographs_is_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["--folder", str(tmp_path)])
    shown = capfd.readouterr()
    assert (left.value.code, shown.out) == (2, "")
    (line,) = shown.err.splitlines()
    assert f"{tmp_path}: no pictures in val/images or test/images" in line
