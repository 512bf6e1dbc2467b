from benchmarks.detector.report import Overhead, medians, overhead, targets

SPEEDS = {"worker_fps": [9.0, 10.0, 30.0], "bare_fps": [8.0], "torch_fps": [4.0, 6.0], "bare_torch_fps": [5.005]}


def test_a_speed_is_the_median_of_its_repeats() -> None:
    found = medians(SPEEDS)
    assert (found["worker_fps"], found["bare_fps"], found["torch_fps"]) == (10.0, 8.0, 5.0)
    assert found["spread"]["worker_fps"] == [9.0, 30.0]


def took(milliseconds: float) -> Overhead:
    return Overhead(milliseconds, {"bus": milliseconds})


def test_overhead_is_its_median_and_its_hundredth_worst() -> None:
    found = overhead([took(each) for each in range(1, 201)])
    assert (found["overhead_p50_ms"], found["overhead_p99_ms"], found["overhead_samples"]) == (100.5, 199, 200)
    assert overhead([took(4.0)]) == {
        "overhead_p50_ms": 4.0,
        "overhead_p99_ms": 4.0,
        "overhead_stages_ms": {"bus": 4.0},
        "overhead_samples": 1,
    }


def test_the_models_call_is_no_overhead_and_what_no_stage_took_is_the_buss() -> None:
    found = Overhead.of(60_000_000, {"queue": 1_000_000, "prepare": 500_000, "model": 50_000_000})
    assert found == Overhead(10.0, {"queue": 1.0, "prepare": 0.5, "bus": 8.5})


def test_the_targets_by_name() -> None:
    found = {**medians(SPEEDS), **overhead([took(6.0)]), "auto_fps": 10.0, "rss_mb": 600, "rss_growth_mb": 20.01}
    assert {name: target["met"] for name, target in targets(found).items()} == {
        "worker_fps / bare_fps": True,
        "auto_fps / bare_fps": False,
        "torch_fps / bare_torch_fps": True,
        "auto_fps / torch_fps": True,
        "overhead_p50_ms": True,
        "overhead_p99_ms": True,
        "rss_mb": True,
        "rss_growth_mb": False,
    }
