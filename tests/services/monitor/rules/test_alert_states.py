"""The states of an alert: raised, acknowledged, escalated, resolved, and kept over a restart."""

from typing import Any

import msgspec
import pytest

from schemas.alerts import AlertState
from schemas.keys import CameraKey
from services.monitor.rules.findings import CameraState
from services.monitor.rules.subjects import UnknownAlertError
from tests.schemas.results import alert
from tests.services.monitor.inventory.seeing import FRONT, S
from tests.services.monitor.rules.ruling import Ruling, book

OVER = {"when": "over", "class": "box", "count": 2}


REAR = CameraKey("r1", "rear")


def test_after_an_alert_there_is_none_for_a_while() -> None:
    ruling = Ruling({**OVER, "cooldown_s": 60})
    assert ruling.look(0, counts={"box": 3}) == ["1 raised"]
    assert ruling.look(1, counts={"box": 0}) == ["1 resolved"]
    assert ruling.look(30, counts={"box": 3}) == []
    assert ruling.look(30, counts={"box": 3}, key=REAR) == ["2 raised"]
    assert ruling.due(59.9) == []
    assert ruling.due(60) == ["3 raised"]


def test_the_life_of_an_alert() -> None:
    ruling = Ruling({**OVER, "escalate_after_s": 10}, {**OVER, "escalate_after_s": 10, "name": "other"})
    assert ruling.look(0, counts={"box": 3}) == ["1 raised", "2 raised"]
    assert ruling.engine.acknowledge("1", S).state is AlertState.ACKNOWLEDGED
    assert ruling.due(9.9) == ["1 acknowledged"]
    assert ruling.due(10) == ["2 escalated"]
    assert ruling.engine.acknowledge("2", 11 * S).state is AlertState.ACKNOWLEDGED
    assert ruling.engine.escalate("1", 11 * S).state is AlertState.ESCALATED
    assert ruling.engine.resolve("1", 12 * S).state is AlertState.RESOLVED
    assert ruling.due(12) == ["2 acknowledged", "1 escalated", "1 resolved"]
    assert ruling.look(13, counts={"box": 4}) == [], "somebody resolved it, and it never stopped"
    assert ruling.look(14, counts={"box": 0}) == ["2 resolved"]
    assert ruling.look(15, counts={"box": 3}) == ["3 raised", "4 raised"]
    for change in (ruling.engine.acknowledge, ruling.engine.escalate, ruling.engine.resolve):
        with pytest.raises(UnknownAlertError, match="'1'"):
            change("1", S)


def test_whether_an_alert_had_escalated_is_known_to_its_end() -> None:
    ruling = Ruling({**OVER, "escalate_after_s": 10})

    def escalated(at_s: float) -> list[tuple[str, bool]]:
        return [(each.alert.state, each.escalated) for each in ruling.engine.due(round(at_s * S))]

    ruling.engine.look(CameraState(FRONT, available=True, counts={"box": 3}), 0)
    ruling.engine.look(CameraState(REAR, available=True, counts={"box": 3}), 0)
    assert escalated(0) == [("raised", False), ("raised", False)]
    ruling.engine.acknowledge("2", S)
    assert escalated(10) == [("acknowledged", False), ("escalated", True)]
    ruling.engine.acknowledge("1", 11 * S)
    ruling.engine.resolve("1", 12 * S)
    ruling.engine.resolve("2", 12 * S)
    assert escalated(12) == [("acknowledged", True), ("resolved", True), ("resolved", False)]


@pytest.mark.parametrize(
    ("state", "changed_s", "escalated"),
    [("raised", 5, False), ("escalated", 6, True), ("acknowledged", 14, False), ("acknowledged", 15, True)],
)
def test_of_an_alert_of_before_it_is_known_too(state: str, changed_s: int, *, escalated: bool) -> None:
    ruling = Ruling({**OVER, "name": "too near", "class": "forklift", "escalate_after_s": 10})
    before = msgspec.structs.replace(
        alert(id_="kept"), state=AlertState(state), raised_ns=5 * S, changed_ns=changed_s * S
    )
    ruling.engine.restore([before], 5 * S)
    ruling.engine.resolve("kept", 14 * S)
    assert [each.escalated for each in ruling.engine.due(14 * S)] == [escalated]


def test_an_alert_of_before_that_somebody_had_escalate_stays_so_though_it_was_acknowledged_early() -> None:
    ruling = Ruling({**OVER, "name": "too near", "class": "forklift", "escalate_after_s": 10})
    before = [alert(id_=name) for name in ("by hand", "not")]
    acknowledged = [
        msgspec.structs.replace(each, state=AlertState.ACKNOWLEDGED, raised_ns=5 * S, changed_ns=6 * S, camera=each.id)
        for each in before
    ]
    ruling.engine.restore(acknowledged, 7 * S, {"by hand"})
    for each in before:
        ruling.engine.resolve(each.id, 8 * S)
    assert [(each.alert.id, each.escalated) for each in ruling.engine.due(8 * S)] == [("by hand", True), ("not", False)]


def test_changes_of_an_alert_are_in_order_though_the_clock_is_set_back() -> None:
    ruling = Ruling(OVER)
    ruling.look(100, counts={"box": 3})
    (raised,) = ruling.engine.alerts()
    assert ruling.engine.acknowledge("1", S).changed_ns == raised.changed_ns + 1


def test_nothing_waits_longer_because_the_clock_is_set_back() -> None:
    ruling = Ruling({**OVER, "for_s": 10, "cooldown_s": 60, "escalate_after_s": 30})
    hour = 3_600
    assert ruling.look(2 * hour, counts={"box": 3}) == []
    assert ruling.look(2 * hour + 4, counts={"box": 3}) == []
    assert ruling.look(hour, counts={"box": 3}) == []
    assert ruling.due(hour + 5) == []
    assert ruling.due(hour + 6) == ["1 raised"]
    assert ruling.due(6) == []
    assert ruling.due(35) == []
    assert ruling.due(36) == ["1 escalated"]
    assert ruling.look(40, counts={"box": 0}) == ["1 resolved"]
    assert ruling.look(30, counts={"box": 3}) == []
    assert ruling.due(55) == []
    assert ruling.due(56) == ["2 raised"]


def test_who_is_missed_since_a_time_that_is_still_to_come_is_missed_from_now_on() -> None:
    ruling = Ruling({"when": "silent", "for_s": 10})
    assert ruling.due(100) == []
    ruling.engine.robot("r1", alive=False, now_ns=3_700 * S)
    assert ruling.due(109) == []
    assert ruling.due(110) == ["1 raised"]


def test_a_disagreement_of_before_about_a_class_that_nobody_remembers_is_over_once_the_models_agree() -> None:
    ruling = Ruling({"name": "new model", "when": "disagree"})
    ruling.engine.restore([msgspec.structs.replace(alert(), rule="new model", name="forklift")], S)
    assert ruling.look(2, key=CameraKey(alert().robot, alert().camera), complete=False) == []
    assert ruling.look(3, key=CameraKey(alert().robot, alert().camera)) == [f"{alert().id} resolved"]


def test_an_alert_of_before_escalates_though_the_clock_was_set_back_meanwhile() -> None:
    ruling = Ruling({**OVER, "name": "too near", "class": "forklift", "escalate_after_s": 10})
    ruling.engine.restore([msgspec.structs.replace(alert(), raised_ns=10**9 * S, changed_ns=10**9 * S)], 7 * S)
    assert ruling.due(16) == []
    assert ruling.due(17) == [f"{alert().id} escalated"]


def test_other_rules_resolve_what_was_theirs_alone() -> None:
    ruling = Ruling(OVER, {**OVER, "for_s": 5})
    assert ruling.look(0, counts={"box": 3}) == ["1 raised"]
    ruling.engine.replace(book(OVER, {**OVER, "for_s": 9}), S)
    assert ruling.due(1) == []
    ruling.engine.replace(book({**OVER, "count": 1}), 2 * S)
    assert ruling.due(2) == ["1 resolved"]
    assert ruling.look(3, counts={"box": 2}) == ["2 raised"]


def test_alerts_of_a_monitor_that_ran_before_go_on() -> None:
    ruling = Ruling({**OVER, "name": "too near", "class": "forklift", "escalate_after_s": 10})
    ruling.engine.restore([alert(id_="kept"), alert(id_="of the rear", robot="r9")], 8)
    assert ruling.look(1, counts={"forklift": 3}) == []
    assert ruling.look(2, counts={"forklift": 0}) == ["kept resolved"]
    assert ruling.due(10.1) == ["of the rear escalated"]
    ruling.engine.restore([msgspec.structs.replace(alert(id_="gone"), rule="no more")], 8)
    assert ruling.due(11) == ["gone resolved"]


@pytest.mark.parametrize(
    "rule",
    [
        {"when": "nearer", "class": "person", "than_m": 2},
        {"when": "nearer", "class": "forklift", "than_m": 2, "robots": ["r2"]},
        {"when": "nearer", "class": "forklift", "than_m": 2, "cameras": ["rear"]},
        {"when": "silent"},
        {"when": "silent", "cameras": ["front"]},
        {"when": "disagree", "class": "person"},
    ],
)
def test_an_alert_of_before_resolves_if_its_rule_is_about_something_else_by_now(rule: dict[str, Any]) -> None:
    ruling = Ruling({"name": "too near", **rule})
    ruling.engine.restore([alert(id_="before")], 8)
    assert ruling.due(1) == ["before resolved"]


def test_a_rule_about_robots_that_becomes_one_about_cameras_is_another() -> None:
    ruling = Ruling({"when": "silent"})
    ruling.engine.robot("r1", alive=False, now_ns=S)
    assert ruling.due(1) == ["1 raised"]
    ruling.engine.replace(book({"when": "silent", "cameras": ["*"]}), 2 * S)
    assert ruling.due(2) == ["1 resolved"]
