import json
from pathlib import Path

import pytest

from benchmarks.accuracy.__main__ import main


@pytest.mark.parametrize("runtime", ["torch", "openvino"])
def test_one_object_on_standard_output_and_progress_elsewhere(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], runtime: str
) -> None:
    sizes = ["--scenes", "1", "--drives", "1", "--drive-frames", "2"]
    options = ["--device", "cpu", "--runtime", runtime, "--workers", "1", "--work-dir", str(tmp_path)]
    main(["--json", *sizes, *options])
    printed = capfd.readouterr()
    found = json.loads(printed.out)
    assert (found["scenes"], found["seeds"]) == (1, [1_600_000, 1_600_000])
    assert (found["drives"], found["drive_seeds"], found["drive_frames"]) == (1, [1_700_000, 1_700_000], 2)
    assert {"mask_map50", "mask_map50_95", "classes_exact", "idf1", "idf1_masks", "machine", "versions"} <= found.keys()
    assert len(found["weights"]["sha256"]) == 64
    assert found["runtime"] == runtime
    assert printed.err.splitlines()[-1] == "follow 1/1"


@pytest.mark.parametrize(
    ("name", "reason"),
    [("garbage.pt", "not a model that can be used"), ("absent.pt", "No such file"), (".", "directory")],
)
def test_bad_weights_are_one_line_before_anything_is_rendered(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, reason: str
) -> None:
    (tmp_path / "garbage.pt").write_bytes(b"nothing of the kind")
    with pytest.raises(SystemExit) as left:
        main(["--weights", str(tmp_path / name), "--work-dir", str(tmp_path / "work")])
    printed = capfd.readouterr()
    assert (left.value.code, printed.out) == (2, "")
    (line,) = printed.err.splitlines()
    assert line.startswith("python -m benchmarks.accuracy: ")
    assert str(tmp_path / name) in line
    assert reason in line
    assert not (tmp_path / "work").exists()


@pytest.mark.parametrize("scenes", ["0", "-1", "many"])
def test_a_number_of_scenes_is_at_least_one(scenes: str, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["--scenes", scenes])
    assert left.value.code == 2
    assert "--scenes" in capfd.readouterr().err
