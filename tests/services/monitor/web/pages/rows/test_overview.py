"""Rows of the overview, and the cells of the wall screen."""

import msgspec
import pytest

from schemas.alerts import Alert, AlertState, Severity
from services.monitor.web.pages.rows.overview import (
    MAX_CAMERAS,
    alert_line,
    in_view,
    lost_line,
    pressing,
    robot_cell,
    robot_row,
    turned,
)
from tests.services.monitor.web.pages.shown import NOW, S, camera, robot, shown


def test_a_robot_that_is_gone_says_since_when_and_its_cameras_are_not_live() -> None:
    row = robot_row(shown(robot(online=False, last_ns=NOW - 90 * S), camera(online=False)), NOW, may_act=False)
    assert (row["state"], row["seen"]) == ("offline", "1 min ago")
    assert row["seen_at"].endswith("+00:00")
    assert [each["live"] for each in row["cameras"]] == [False]


def test_what_is_in_view_is_told_from_nothing_and_from_not_known_yet() -> None:
    cameras = [camera(name="a"), camera(name="b", classes=()), camera(name="c", age_s=None)]
    row = robot_row(shown(robot(), *cameras), NOW, may_act=True)
    assert [each["classes"] for each in row["cameras"]] == [[[2, "box"]], [], None]
    assert (row["dropped"], row["reasons"][0]) == ("1.2k", (1_200, "gateway: thinned"))


def test_no_more_cameras_are_sent_than_are_shown() -> None:
    many = [camera(name=f"c{number}") for number in range(MAX_CAMERAS + 1)]
    row = robot_row(shown(robot(), *many), NOW, may_act=True)
    assert len(row["cameras"]) == MAX_CAMERAS
    assert row["more"] == "and 1 camera more"


def test_operators_may_forget_a_robot_that_is_gone() -> None:
    gone, there = shown(robot(online=False), camera(online=False)), shown(robot(), camera())
    may = [robot_row(each, NOW, may_act=may_act)["forgettable"] for may_act in (True, False) for each in (gone, there)]
    assert may == [True, False, False, False]


ODD = '<b>"r1"</b>'
GONE = Alert(
    id="1",
    rule="gone",
    severity=Severity.CRITICAL,
    state=AlertState.RAISED,
    robot="r1",
    text="r1 is offline",
    raised_ns=NOW - 90 * S,
    changed_ns=NOW,
)


@pytest.mark.parametrize(
    ("turn", "shown_then", "said"),
    [(0, [0, 1, 2], "1-3 of 7"), (1, [3, 4, 5], "4-6 of 7"), (2, [6], "7-7 of 7"), (3, [0, 1, 2], "1-3 of 7")],
)
def test_what_does_not_fit_is_shown_page_after_page_and_over_again(turn: int, shown_then: list[int], said: str) -> None:
    some, which = turned(range(7), 3, turn)
    assert (list(some), str(which)) == (shown_then, said)


def test_what_fits_stays_and_says_no_more() -> None:
    for count in (0, 3):
        for turn in (0, 1):
            some, which = turned(range(count), 3, turn)
            assert (len(some), str(which)) == (count, "")


def test_critical_alerts_come_before_lost_robots_and_neither_says_the_same_twice() -> None:
    seen = msgspec.structs.replace(GONE, id="2", camera="front", name="box", robot="r2", raised_ns=NOW)
    warning = msgspec.structs.replace(GONE, id="3", severity=Severity.WARNING, robot="r3")
    assert pressing([warning, GONE, seen], ["r1", "r2", "r3"]) == [seen, GONE, "r2", "r3"]


def test_an_alert_says_how_old_it_is_who_looks_after_it_and_whether_it_is_known_now() -> None:
    line = alert_line(msgspec.structs.replace(GONE, text=ODD, state=AlertState.ACKNOWLEDGED), "", NOW)
    assert "&lt;b&gt;" in line
    assert "<b>" not in line
    assert "acknowledged, 1 min ago" in line
    assert "fs-stale" not in line
    doubtful = alert_line(GONE, "not known now: r1 is offline", NOW)
    assert "r1 is offline, not known now: r1 is offline" in doubtful
    assert "fs-stale" in doubtful


def test_a_lost_robot_says_why_and_since_when() -> None:
    line = lost_line(shown(robot(online=False, last_ns=NOW - 90 * S), camera(online=False)), NOW)
    assert "r1: its gateway is gone" in line
    assert "last seen 1 min ago" in line


def test_a_robot_says_what_is_wrong_and_what_its_live_cameras_have_in_view() -> None:
    cameras = [
        camera(name="a", classes=[("box", 2), (ODD, 1)]),
        camera(name="b", classes=[("box", 3)]),
        camera(name="c", age_s=60.0, classes=[("person", 9)]),
    ]
    of = shown(robot(problems=("waits for a ROS master",)), *cameras)
    assert in_view(of) == f"5 box, 1 {ODD} in 2 views"
    cell = robot_cell(of)
    assert "waits for a ROS master" in cell
    assert "fs-trouble" in cell
    assert "<b>" not in cell
    assert in_view(shown(robot(), camera(classes=()))) == "nothing in view"
    assert in_view(shown(robot(), camera(age_s=None))) == "objects in view are unknown"
