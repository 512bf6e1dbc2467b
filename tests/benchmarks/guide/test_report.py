import pytest

from benchmarks.guide.report import Run, Runs, figures, targets


def run(sets: int, *ages_ms: float, cpu_s: float = 1.0) -> Run:
    return Run(
        seconds=2.0,
        sets=sets,
        cpu_s={"one": cpu_s, "other": cpu_s / 2},
        shares={},
        ages_ms=ages_ms,
        others_cores=0.25,
    )


SIDES = {
    "guide": Runs([run(2), run(4), run(3)], [run(3, 900, 1000, 800)]),
    "fleetsight_torch": Runs([run(12), run(10), run(16)], [run(3, 300)]),
    "fleetsight_best": Runs([run(17), run(18), run(40)], [run(3, 250, 350)]),
}


def test_rates_and_ages_are_medians() -> None:
    found = figures(SIDES)
    assert (found["guide_sets_per_s_torch"], found["fleetsight_sets_per_s_torch"]) == (1.5, 6)
    assert found["fleetsight_sets_per_s_best"] == 9
    assert (found["guide_age_p50_ms_1hz"], found["fleetsight_age_p50_ms_1hz"]) == (900, 300)
    assert found["spread"]["guide_sets_per_s_torch"] == [1, 2]
    assert found["spread"]["guide_age_p50_ms_1hz"] == [800, 1000]
    assert found["cores_busy_elsewhere"] == 0.25


def test_processor_time_for_each_set() -> None:
    found = figures(SIDES)
    assert (found["guide_cpu_ms_per_set"], found["guide_cpu_ms_per_set_1hz"]) == (500, 500)
    assert found["guide_cpu_ms_per_set_1hz_by_process"] == {"one": pytest.approx(333.3), "other": pytest.approx(166.7)}


def test_processes_that_work_on_images_of_their_own() -> None:
    apart = Run(
        seconds=2.0, sets=1, cpu_s={"one": 1.0, "other": 1.0}, shares={"one": 1, "other": 4}, ages_ms=[], others_cores=0
    )
    assert apart.cpu_ms_per_set == 1250
    assert apart.balanced_sets_per_s == pytest.approx(0.8)
    found = figures({"guide": Runs([apart], [apart])})
    assert found["guide_cpu_ms_per_set_1hz_by_process"] == {"one": 1000, "other": 250}
    assert (found["guide_balanced_sets_per_s"], found["guide_sets_per_s_torch"]) == (0.8, 0.5)


def test_targets() -> None:
    met = {name: (target["ratio"], target["met"]) for name, target in targets(figures(SIDES)).items()}
    assert met == {
        "fleetsight_sets_per_s_torch / guide_sets_per_s_torch": (4, True),
        "fleetsight_sets_per_s_best / guide_sets_per_s_torch": (6, True),
        "fleetsight_age_p50_ms_1hz / guide_age_p50_ms_1hz": (0.333, True),
    }


def test_nothing_whole_meets_no_target() -> None:
    nothing = Runs([run(0)], [run(0)])
    found = figures({**SIDES, "guide": nothing})
    assert (found["guide_sets_per_s_torch"], found["guide_age_p50_ms_1hz"]) == (0, None)
    assert found["guide_cpu_ms_per_set"] is None
    assert found["guide_balanced_sets_per_s"] is None
    assert found["guide_cpu_ms_per_set_1hz_by_process"] == {"one": None, "other": None}
    assert not any(target["met"] for target in targets(found).values())
