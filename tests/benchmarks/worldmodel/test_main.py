import json
from pathlib import Path

import pytest

from benchmarks.worldmodel.__main__ import main
from benchmarks.worldmodel.load import Load, measured_apart


@pytest.mark.timeout(300)
def test_one_object_on_standard_output_with_both_models_beside_each_other(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.worldmodel.__main__.HZ", 0.2)
    monkeypatch.setattr("benchmarks.worldmodel.__main__.DRIVE_FRAMES", 8)
    options = [
        "--warehouses",
        "1",
        "--seconds",
        "60",
        "--changing-seconds",
        "30",
        "--drives",
        "1",
        "--load-seconds",
        "0",
        "--runtime",
        "torch",
    ]
    main(["--json", *options, "--work-dir", str(tmp_path)])
    found = json.loads(capfd.readouterr().out)
    assert found["warehouses"] == 1
    for figures in (found, found["exact_poses"], found["merging_0_6_m"]):
        assert 0 < figures["inventory_f1"] <= 1
        assert {"count_error", "duplicates", "position_error_p50_m", "id_purity"} <= figures.keys()
    assert 0 < found["lost_robot"]["inventory_f1"] <= 1
    assert found["false_gone"] >= 0
    assert found["changes"] >= 0
    assert 0 < found["idf1_by_place"] <= 1
    assert 0 < found["idf1_by_tracker_masks"] <= 1
    assert found["load"] == {}
    assert {"inventory_f1", "id_purity", "forklifts_exact", "noticed_p95_s", "false_gone", "moved_seen_kept_id"} <= set(
        found["targets"]
    )
    assert {"machine", "versions", "weights"} <= found.keys()


def test_the_load_is_of_objects_that_are_known() -> None:
    found = measured_apart(Load(cameras=10, objects=15, known=150, seconds=1))
    assert found["known_objects"] == 150
    assert (found["views_per_s"], found["sightings_per_s"]) == (20, 300)
    assert found["busy_share"] > 0
    assert found["rss_mb"] < 500
    assert found["lag_p99_ms"] >= found["lag_p50_ms"] > 0


def test_bad_weights_are_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["--weights", str(tmp_path / "absent.pt"), "--work-dir", str(tmp_path / "work")])
    shown = capfd.readouterr()
    assert (left.value.code, shown.out) == (2, "")
    assert "absent.pt" in shown.err.splitlines()[-1]
