import json

import pytest

from benchmarks.space.report import TARGETS, report

SAMPLES = {
    "distance_gt_masks": [0.001, 0.003],
    "distance": [0.01] * 99 + [0.5],
    "guide_distance": [0.4, 0.6],
    "guide_distance_metres": [0.2],
    "distance_unregistered": [0.02],
    "centroid_excess": [-0.04, -0.01],
    "box_extent": [0.05, 0.07],
    "foreign_points": [0.0, 0.01],
    "map_spread": [0.03],
}
TIMES = {"distance": [1.0, 2.0, 9.0], "cloud": [4.0], "lidar": [5.0], "guide_distance": [30.0], "guide_cloud": [20.0]}


def test_the_figures_have_the_names_of_the_targets() -> None:
    found = report(SAMPLES, TIMES, TIMES)
    assert found["distance_mae_rel_gt_masks"] == 0.002
    assert found["distance_mae_rel"] == 0.0149
    assert found["distance_p99_rel"] == pytest.approx(0.0149)
    assert found["guide_distance_mae_rel"] == 0.5
    assert found["foreign_points"] == 0.005
    assert (found["distance_ms_p50"], found["guide_distance_ms_p50"], found["distance_cpu_ms_p50"]) == (2.0, 30.0, 2.0)
    assert found["targets"].keys() == {*TARGETS, "guide_cloud_ms_p50 / cloud_ms_p50"}
    assert all(target["met"] for target in found["targets"].values())
    assert json.loads(json.dumps(found, allow_nan=False)) == found


@pytest.mark.parametrize(("over", "met"), [(50, True), (51, False)])
def test_of_twenty_centroids_one_may_be_farther_off(over: int, met: bool) -> None:  # noqa: FBT001 - a parameter of the test
    found = report({**SAMPLES, "centroid_excess": [0.0] * (1001 - over) + [0.5] * over}, TIMES, TIMES)
    assert found["targets"]["centroid_excess_m"]["met"] is met
    assert found["centroid_excess_m"] == (0.0 if met else 0.5)


def test_how_far_off_the_worst_centroid_is_and_how_many_are_is_said_too() -> None:
    found = report({**SAMPLES, "centroid_excess": [-0.05] * 999 + [0.001]}, TIMES, TIMES)
    assert found["centroid_excess_m"] == -0.05
    assert found["centroid_excess_m_worst"] == 0.001
    assert found["centroids_over"] == 0.001
    assert found["spread"]["centroid_excess"] == {
        "objects": 1000,
        "mean": -0.0499,
        "p50": -0.05,
        "p95": -0.05,
        "p99": -0.05,
        "max": 0.001,
    }


@pytest.mark.parametrize(("cloud_ms", "met"), [(4.0, True), (4.01, False)])
def test_clouds_are_to_be_five_times_faster(cloud_ms: float, met: bool) -> None:  # noqa: FBT001 - a parameter of the test
    found = report(SAMPLES, {**TIMES, "cloud": [cloud_ms]}, TIMES)
    assert found["targets"]["guide_cloud_ms_p50 / cloud_ms_p50"]["met"] is met


@pytest.mark.parametrize("name", TARGETS)
def test_what_is_just_within_a_target_meets_it(name: str) -> None:
    exact = {
        "distance_gt_masks": [0.005],
        "distance": [0.02, 0.02],
        "distance_unregistered": [0.025],
        "centroid_excess": [0.0],
        "box_extent": [0.1],
        "foreign_points": [0.01],
        "map_spread": [0.1],
    }
    times = {**TIMES, "distance": [3.0], "cloud": [10.0], "lidar": [15.0]}
    assert report({**SAMPLES, **exact}, times, TIMES)["targets"][name]["met"]
