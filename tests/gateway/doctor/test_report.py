import json

import pytest

from gateway.doctor.finding import Stage, fine, note, problem
from gateway.doctor.report import as_json, as_text

FINDINGS = [
    fine(Stage.MASTER, "http://robot:11311", "answers"),
    problem(Stage.SENSORS, "front/color", "nobody publishes it", "start the sensor's driver"),
    fine(Stage.DEMAND, "front/color", "nobody subscribes"),
    fine(Stage.DEMAND, "rear/color", "nobody subscribes"),
    note(Stage.DEMAND, "tf", "nobody subscribes"),
]


def test_text_is_sorted_by_stage_and_says_alike_things_once() -> None:
    assert as_text(FINDINGS, 80).splitlines() == [
        "ROS master",
        "  ok       http://robot:11311: answers",
        "",
        "sensors",
        "  PROBLEM  front/color: nobody publishes it",
        "           -> start the sensor's driver",
        "",
        "demand",
        "  ok       front/color, rear/color: nobody subscribes",
        "  note     tf: nobody subscribes",
        "",
        "1 problem; the first to solve: front/color: nobody publishes it",
    ]


def test_text_without_problems() -> None:
    assert as_text(FINDINGS[:1], 80).endswith("\nNo problems found: every stream that is wanted can flow.")


def test_several_problems_are_counted() -> None:
    assert as_text(FINDINGS[1:2] * 3, 80).splitlines()[-1].startswith("3 problems; ")


@pytest.mark.parametrize("width", [1, 40, 60])
def test_lines_are_as_wide_as_the_terminal(width: int) -> None:
    *lines, _ = as_text([problem(Stage.SENSORS, "front/color", "word " * 50, "advice " * 50)], width).splitlines()
    assert len(lines) > 8
    assert max(map(len, lines)) <= max(width, 40)


def test_json_for_programs() -> None:
    report = json.loads(as_json(FINDINGS))
    assert report["ok"] is False
    assert report["findings"][1] == {
        "severity": "problem",
        "stage": "sensors",
        "subject": "front/color",
        "what": "nobody publishes it",
        "advice": "start the sensor's driver",
    }
    assert json.loads(as_json(FINDINGS[:1]))["ok"] is True


def test_what_others_are_called_is_shown_as_it_is_written() -> None:
    text = as_text([problem(Stage.SENSORS, "/a\x1b[2J", "gone", "start /a\x07")], 80)
    assert text.count(r"/a\x1b[2J: gone") == 2
    assert r"-> start /a\x07" in text
    assert text.replace("\n", "").isprintable()
