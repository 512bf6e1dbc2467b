from benchmarks.detector.report import medians, overhead, targets

SPEEDS = {"worker_fps": [9.0, 10.0, 30.0], "bare_fps": [8.0], "torch_fps": [4.0, 6.0], "bare_torch_fps": [5.005]}


def test_a_speed_is_the_median_of_its_repeats() -> None:
    found = medians(SPEEDS)
    assert (found["worker_fps"], found["bare_fps"], found["torch_fps"]) == (10.0, 8.0, 5.0)
    assert found["spread"]["worker_fps"] == [9.0, 30.0]


def test_overhead_is_its_median_and_its_hundredth_worst() -> None:
    assert overhead([*range(1, 201)]) == {"overhead_p50_ms": 100.5, "overhead_p99_ms": 199, "overhead_samples": 200}
    assert overhead([4.0]) == {"overhead_p50_ms": 4.0, "overhead_p99_ms": 4.0, "overhead_samples": 1}


def test_the_targets_by_name() -> None:
    found = {**medians(SPEEDS), **overhead([6.0]), "auto_fps": 10.0, "rss_growth_mb": 20.01}
    assert {name: target["met"] for name, target in targets(found).items()} == {
        "worker_fps / bare_fps": True,
        "torch_fps / bare_torch_fps": True,
        "auto_fps / torch_fps": True,
        "overhead_p50_ms": True,
        "overhead_p99_ms": True,
        "rss_growth_mb": False,
    }
