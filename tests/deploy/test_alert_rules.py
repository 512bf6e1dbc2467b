"""The chart's alerts, evaluated by Prometheus' own promtool on series of our metrics."""

from pathlib import Path

import pytest

from services.detector.frame_counts import REPLACED
from tests.deploy.support.helm import RULES
from tests.deploy.support.prometheus import raised, rules_of

DETECTOR_W0 = f'{{service="detector", worker="w0", reason="{REPLACED}"}}'
"""Labels of series of a worker. Those that have no reason have one here."""


def given(series: str, *values: str) -> list[dict[str, str]]:
    return [{"series": series, "values": " ".join(values)}]


@pytest.mark.parametrize(
    ("alert", "series", "labels"),
    [
        ("MonitorIsGone", given("up", "0x40"), {}),
        ("MonitorHearsNothing", given("fleetsight_mesh_up", "0x40"), {}),
        ("HistoryIsNotKept", given("fleetsight_history_kept", "0x40"), {}),
        ("LinksRunOut", given("fleetsight_links", "950x40") + given("fleetsight_links_limit", "1000x40"), {}),
        (
            "RobotGone",
            given('fleetsight_robot_online{robot="r1"}', "0x40")
            + given('fleetsight_robot_last_seen_seconds{robot="r1"}', "60x40"),
            {"robot": "r1"},
        ),
        (
            "MoreDetectorsNeeded",
            given(f"fleetsight_worker_busy_seconds_total{DETECTOR_W0}", "0+60x40")
            + given(f"fleetsight_worker_frames_dropped_total{DETECTOR_W0}", "0+1200x40"),
            {},
        ),
    ],
)
def test_each_alert_is_raised_by_what_it_is_about_and_not_by_a_fleet_that_is_well(
    tmp_path: Path, alert: str, series: list[dict[str, str]], labels: dict[str, str]
) -> None:
    well = [
        *given("fleetsight_robots", "3x40"),
        *given("fleetsight_mesh_up", "1x40"),
        *given("fleetsight_history_kept", "1x40"),
        *given("fleetsight_links", "10x40"),
        *given("fleetsight_links_limit", "1000x40"),
        *given('fleetsight_robot_online{robot="r1"}', "1x40"),
        *given('fleetsight_robot_last_seen_seconds{robot="r1"}', "0+60x40"),
        *given(f"fleetsight_worker_online{DETECTOR_W0}", "1x40"),
        *given(f"fleetsight_worker_busy_seconds_total{DETECTOR_W0}", "0+30x40"),
        *given(f"fleetsight_worker_frames_inferred_total{DETECTOR_W0}", "0+600x40"),
        *given(f"fleetsight_worker_frames_dropped_total{DETECTOR_W0}", "0x40"),
    ]
    alerts = rules_of(RULES, "alert")
    assert alert in alerts
    assert raised(RULES, well, tmp_path) == {name: [] for name in alerts}
    others = {} if alert == "MonitorIsGone" else {each["series"]: each for each in well}
    ill = [*{**others, **{each["series"]: each for each in series}}.values()]
    assert raised(RULES, ill, tmp_path)[alert] == [labels]
