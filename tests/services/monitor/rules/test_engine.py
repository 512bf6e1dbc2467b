from typing import Any

import pytest

from schemas.keys import CameraKey
from services.monitor.inventory.sighting import ChangeKind
from tests.services.monitor.inventory.seeing import S
from tests.services.monitor.rules.ruling import Ruling

OVER = {"when": "over", "class": "box", "count": 2}


REAR = CameraKey("r1", "rear")


def test_what_appears_is_alerted_until_it_is_gone() -> None:
    ruling = Ruling({"when": "appears", "class": "box"})
    assert ruling.changed(1, ChangeKind.APPEARED, "pallet") == []
    assert ruling.changed(1, ChangeKind.APPEARED, first_look=True) == []
    assert ruling.changed(2, ChangeKind.APPEARED) == ["1 raised"]
    assert ruling.texts() == ["box appeared in view of r1/front"]
    assert ruling.changed(3, ChangeKind.COUNTED) == []
    assert ruling.changed(4, ChangeKind.LOST) == []
    assert ruling.changed(5, ChangeKind.VANISHED) == ["1 resolved"]


def test_what_disappears_is_alerted_until_it_is_back() -> None:
    ruling = Ruling({"when": "disappears", "class": "box"})
    assert ruling.changed(1, ChangeKind.APPEARED) == []
    assert ruling.changed(2, ChangeKind.VANISHED) == ["1 raised"]
    assert ruling.changed(3, ChangeKind.APPEARED, first_look=True) == ["1 resolved"]


def test_what_nobody_saw_go_or_come_back_is_over_when_the_camera_speaks() -> None:
    ruling = Ruling({"when": "appears", "class": "box"}, {"when": "disappears", "class": "pallet"})
    assert ruling.changed(1, ChangeKind.APPEARED) == ["1 raised"]
    assert ruling.changed(1, ChangeKind.VANISHED, "pallet") == ["2 raised"]
    assert ruling.look(2, counts={"box": 1, "pallet": 0}) == []
    assert ruling.look(3, available=False, counts={"pallet": 1}) == []
    assert ruling.look(4, counts={"pallet": 1}) == ["1 resolved", "2 resolved"]
    assert ruling.changed(5, ChangeKind.APPEARED) == ["3 raised"]


@pytest.mark.parametrize(
    ("rule", "so", "not_so", "text"),
    [
        (OVER, {"counts": {"box": 3}}, {"counts": {"box": 2}}, "3 box in view of r1/front, over 2"),
        (
            {"when": "under", "class": "box", "count": 2},
            {"counts": {"box": 1}},
            {"counts": {"box": 2}},
            "1 box in view of r1/front, under 2",
        ),
        (
            {"when": "under", "class": "box", "count": 1},
            {"counts": {}},
            {"counts": {"box": 1}},
            "0 box in view of r1/front, under 1",
        ),
        (
            {"when": "nearer", "class": "box", "than_m": 2},
            {"nearest": {"box": 1.99}},
            {"nearest": {"box": 2.0}},
            "box 1.99 m from r1/front, nearer than 2 m",
        ),
        (
            {"when": "nearer", "class": "box", "than_m": 2},
            {"nearest": {"box": 1}},
            {},
            "box 1.00 m from r1/front, nearer than 2 m",
        ),
        (
            {"when": "disagree"},
            {"counts": {"box": 1}, "disagreements": {"box": (1, 2)}},
            {"counts": {"box": 1}},
            "two models count 1 and 2 box in view of r1/front",
        ),
    ],
)
def test_what_holds_is_alerted_until_it_does_not(
    rule: dict[str, Any], so: dict[str, Any], not_so: dict[str, Any], text: str
) -> None:
    ruling = Ruling(rule)
    assert ruling.look(1, **not_so) == []
    assert ruling.look(2, **so) == ["1 raised"]
    assert ruling.texts() == [text]
    assert ruling.look(3, **so) == []
    assert ruling.look(4, available=False, **not_so) == [], "what is not known resolves nothing"
    assert ruling.look(5, **not_so) == ["1 resolved"]
    assert ruling.look(6, available=False, **so) == []


def test_a_disagreement_about_another_class_is_none() -> None:
    ruling = Ruling({"when": "disagree", "class": "pallet"})
    assert ruling.look(1, counts={"box": 1}, disagreements={"box": (1, 2)}) == []


def test_silence_of_robots_and_of_cameras() -> None:
    ruling = Ruling({"when": "silent", "for_s": 10}, {"when": "silent", "cameras": ["rear"]})
    ruling.engine.robot("r1", alive=False, now_ns=S)
    assert ruling.due(10.9) == []
    assert ruling.due(11) == ["1 raised"]
    assert ruling.texts() == ["r1 is offline"]
    ruling.engine.robot("r1", alive=True, now_ns=12 * S)
    assert ruling.due(12) == ["1 resolved"]
    assert ruling.look(13, available=False, silent_ns=13 * S) == []
    assert ruling.look(13, available=False, key=REAR) == []
    assert ruling.look(13, available=False, silent_ns=13 * S, key=REAR) == ["2 raised"]
    assert ruling.texts() == ["r1/rear is silent"]
    assert ruling.look(14, key=REAR) == ["2 resolved"]


def test_silence_that_is_not_known_raises_and_resolves_nothing() -> None:
    ruling = Ruling({"when": "silent", "for_s": 10}, {"when": "silent", "cameras": ["*"], "for_s": 10})
    ruling.engine.robot("r1", alive=None, now_ns=0)
    ruling.engine.robot("r2", alive=False, now_ns=S)
    assert ruling.look(5, available=False, silent_ns=S) == []
    ruling.engine.robot("r2", alive=None, now_ns=6 * S)
    assert ruling.look(6, available=False) == []
    assert ruling.due(60) == []
    ruling.engine.robot("r2", alive=False, now_ns=S)
    assert ruling.look(61, available=False, silent_ns=S) == ["1 raised", "2 raised"], "it held since before"
    ruling.engine.robot("r2", alive=None, now_ns=62 * S)
    assert ruling.look(62, available=False) == []
    ruling.engine.robot("r2", alive=True, now_ns=63 * S)
    assert ruling.look(63) == ["1 resolved", "2 resolved"]


def test_for_so_long_counts_from_when_the_silence_began_not_from_when_it_was_sure() -> None:
    ruling = Ruling({"when": "silent", "cameras": ["*"], "for_s": 10})
    assert ruling.look(3, available=False, silent_ns=S) == []
    assert ruling.due(10.9) == []
    assert ruling.due(11) == ["1 raised"]


@pytest.mark.parametrize(
    ("rule", "so"),
    [
        ({"when": "nearer", "class": "box", "than_m": 2}, {"counts": {"box": 1}, "nearest": {"box": 1}}),
        ({"when": "disagree"}, {"counts": {"box": 1}, "disagreements": {"box": (1, 2)}}),
    ],
)
def test_what_is_still_to_come_after_a_deaf_time_raises_and_resolves_nothing(
    rule: dict[str, Any], so: dict[str, Any]
) -> None:
    for for_s, before in ((0, ["1 raised"]), (5, [])):
        ruling = Ruling({**rule, "for_s": for_s})
        assert ruling.look(1, **so) == before
        assert ruling.look(2, available=False) == []
        assert ruling.look(30, counts={"box": 1}, complete=False) == []
        assert ruling.due(31) == []
        assert ruling.look(32, **so, complete=False) == ([] if before else ["1 raised"])
        assert ruling.look(33, counts={"box": 1}) == ["1 resolved"]


def test_it_must_hold_without_a_gap() -> None:
    ruling = Ruling({**OVER, "for_s": 2})
    assert ruling.look(0, counts={"box": 3}) == []
    assert ruling.look(1, counts={"box": 0}) == []
    assert ruling.look(1.5, counts={"box": 3}) == []
    assert ruling.due(3.4) == []
    assert ruling.due(3.5) == ["1 raised"]


@pytest.mark.parametrize(
    ("rule", "so", "not_so"),
    [
        (OVER, {"counts": {"box": 3}}, {"counts": {"box": 2}}),
        ({"when": "appears", "class": "box"}, {"counts": {"box": 1}}, {"counts": {"box": 0}}),
    ],
)
def test_what_is_not_known_any_more_is_raised_once_it_is(
    rule: dict[str, Any], so: dict[str, Any], not_so: dict[str, Any]
) -> None:
    for back, states in ((so, ["1 raised"]), (not_so, [])):
        ruling = Ruling({**rule, "for_s": 10})
        ruling.changed(0, ChangeKind.APPEARED)
        assert ruling.look(0, **so) == []
        assert ruling.look(5, available=False, **so) == []
        assert ruling.due(20) == []
        assert ruling.look(30, **back) == states


def test_what_was_in_view_of_a_robot_that_is_switched_off_is_not_raised_at_night() -> None:
    ruling = Ruling({**OVER, "between": ["22:00", "06:00"]})
    assert ruling.look(18 * 3_600, counts={"box": 3}) == []
    assert ruling.look(19 * 3_600, available=False, counts={"box": 3}) == []
    assert ruling.due(22 * 3_600) == []


def test_robots_and_cameras_can_be_chosen() -> None:
    ruling = Ruling({**OVER, "robots": ["r*"], "cameras": ["rear"]})
    many: Any = {"counts": {"box": 3}}
    assert ruling.look(1, **many) == []
    assert ruling.look(1, key=CameraKey("s1", "rear"), **many) == []
    assert ruling.look(1, key=REAR, **many) == ["1 raised"]


@pytest.mark.parametrize(
    ("between", "hour", "raised"),
    [
        (["08:00", "17:00"], 7.99, False),
        (["08:00", "17:00"], 8, True),
        (["08:00", "17:00"], 17, False),
        (["22:00", "06:00"], 23, True),
        (["22:00", "06:00"], 5.99, True),
        (["22:00", "06:00"], 12, False),
    ],
)
def test_hours(between: list[str], hour: float, *, raised: bool) -> None:
    ruling = Ruling({**OVER, "between": between})
    assert (ruling.look(hour * 3600, counts={"box": 3}) == ["1 raised"]) is raised


def test_days_and_what_still_holds_when_the_time_comes() -> None:
    ruling = Ruling({**OVER, "days": ["fri"]})
    assert ruling.look(23 * 3600, counts={"box": 3}) == [], "the epoch began on a Thursday"
    assert ruling.due(24 * 3600) == ["1 raised"]


@pytest.mark.parametrize(
    ("days", "hour", "raised"),
    [
        (["thu"], 23, True),
        (["thu"], 24 + 5, True),
        (["thu"], 24 + 23, False),
        (["thu"], 5, False),
        (["wed"], 5, True),
        (["fri"], 24 + 5, False),
    ],
)
def test_a_night_is_of_the_day_that_it_began_on(days: list[str], hour: float, *, raised: bool) -> None:
    ruling = Ruling({**OVER, "between": ["22:00", "06:00"], "days": days})
    assert (ruling.look(hour * 3600, counts={"box": 3}) == ["1 raised"]) is raised, "the epoch began on a Thursday"


def test_subjects_are_bounded() -> None:
    ruling = Ruling({**OVER, "cooldown_s": 60}, most=1)
    assert ruling.look(0, counts={"box": 3}) == ["1 raised"]
    assert ruling.look(0, counts={"box": 3}, key=REAR) == []
    assert not ruling.engine.has_room_again()
    assert ruling.look(0, counts={"box": 3}, key=REAR) == []
    assert ruling.look(1, counts={"box": 0}) == ["1 resolved"]
    assert [ruling.engine.has_room_again() for _ in range(2)] == [True, False]
    assert ruling.look(1, counts={"box": 3}, key=REAR) == ["2 raised"]


def test_what_is_remembered_for_its_cooldown_makes_room_for_what_holds() -> None:
    ruling = Ruling({**OVER, "cooldown_s": 60}, most=1)
    assert ruling.look(0, counts={"box": 3}) == ["1 raised"]
    assert ruling.look(1, counts={"box": 0}) == ["1 resolved"]
    assert ruling.look(2, counts={"box": 3}, key=REAR) == ["2 raised"]
    assert ruling.look(3, counts={"box": 0}, key=REAR) == ["2 resolved"]


@pytest.mark.parametrize(
    ("rule", "holds", "over"),
    [
        (OVER, {"counts": {"box": 3}}, {"counts": {"box": 0}}),
        (
            {"when": "nearer", "class": "box", "than_m": 2},
            {"counts": {"box": 1}, "nearest": {"box": 1.0}},
            {"counts": {}},
        ),
        ({"when": "disagree"}, {"counts": {"box": 1}, "disagreements": {"box": (1, 2)}}, {"counts": {"box": 1}}),
    ],
)
def test_what_does_not_count_yet_ends_no_alert(
    rule: dict[str, Any], holds: dict[str, Any], over: dict[str, Any]
) -> None:
    ruling = Ruling(rule)
    assert ruling.look(1, **holds) == ["1 raised"]
    assert ruling.look(2, settled=False, **over) == []
    assert ruling.look(3, settled=True, **over) == ["1 resolved"]


def test_what_appeared_is_gone_only_once_it_would_count_if_it_were_there() -> None:
    ruling = Ruling({"when": "appears", "class": "box"})
    assert ruling.changed(1, ChangeKind.APPEARED) == ["1 raised"]
    assert ruling.look(2, settled=False) == []
    assert ruling.look(3, counts={"box": 1}) == []
    assert ruling.look(4) == ["1 resolved"]
