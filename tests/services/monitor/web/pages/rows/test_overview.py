from services.monitor.web.pages.rows.overview import MAX_CAMERAS, robot_row
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
