"""Rows of alerts."""

import msgspec
import pytest

from schemas.alerts import Alert, AlertState, Severity
from services.monitor.history.state import Act
from services.monitor.inventory.inventory import Inventory
from services.monitor.web.pages.rows.alerts import (
    Panel,
    alert_row,
    doubt_of,
    panel_of,
    raised_by,
    severity_figures,
    sorted_alerts,
    unattended_figure,
    wanted_alerts,
)
from services.monitor.web.pages.rows.formatting import NOTHING

S = 1_000_000_000
ALERT = Alert(
    id="1",
    rule="near",
    severity=Severity.WARNING,
    state=AlertState.RAISED,
    robot="r1",
    camera="front",
    name="forklift",
    text="forklift near",
    raised_ns=100 * S,
    changed_ns=100 * S,
)


def alert(number: int, severity: Severity = Severity.WARNING, state: AlertState = AlertState.RAISED) -> Alert:
    return msgspec.structs.replace(
        ALERT, id=str(number), severity=severity, state=state, robot=f"r{number}", raised_ns=number * S
    )


ALERTS = [
    alert(1, Severity.INFO),
    alert(2, Severity.CRITICAL, AlertState.ACKNOWLEDGED),
    alert(3, Severity.CRITICAL),
    alert(10, Severity.CRITICAL, AlertState.ESCALATED),
    alert(11, Severity.CRITICAL),
]


def ids(alerts: list[Alert]) -> list[str]:
    return [each.id for each in alerts]


def test_the_most_urgent_come_first_then_those_that_nobody_looks_after() -> None:
    assert ids(sorted_alerts(ALERTS, "severity", descending=False)) == ["10", "11", "3", "2", "1"]
    assert ids(sorted_alerts(ALERTS, "severity", descending=True)) == ["1", "2", "3", "11", "10"]


def test_alerts_are_sorted_by_what_is_asked_for() -> None:
    assert ids(sorted_alerts(ALERTS, "robot", descending=False)) == ["1", "2", "3", "10", "11"]
    assert ids(sorted_alerts(ALERTS, "raised", descending=False)) == ["11", "10", "3", "2", "1"]
    assert ids(sorted_alerts(ALERTS, "state", descending=False))[0] == "10"


def test_alerts_are_chosen_by_severity_and_text() -> None:
    assert ids(wanted_alerts(ALERTS, Severity.INFO, "")) == ["1"]
    assert ids(wanted_alerts(ALERTS, None, " FORK ")) == ids(ALERTS)
    assert ids(wanted_alerts(ALERTS, None, "r10")) == ["10"]


@pytest.mark.parametrize(
    ("state", "actions"),
    [
        (AlertState.RAISED, ["acknowledge", "escalate", "resolve"]),
        (AlertState.ACKNOWLEDGED, ["escalate", "resolve"]),
        (AlertState.ESCALATED, ["acknowledge", "resolve"]),
        (AlertState.RESOLVED, []),
    ],
)
def test_what_may_be_done_depends_on_the_state_and_on_who_looks(state: AlertState, actions: list[str]) -> None:
    assert alert_row(alert(1, state=state), (), 0, may_act=True)["actions"] == actions
    assert alert_row(alert(1, state=state), (), 0, may_act=False)["actions"] == []


def test_who_did_what_is_said() -> None:
    row = alert_row(ALERT, [Act("1", AlertState.ACKNOWLEDGED, "ann", 130 * S)], 160 * S, may_act=False)
    assert row["acts"] == ["acknowledged by ann, 30 s ago"]
    assert (row["raised"], row["ended"]) == ("1 min ago", "")


def test_why_nobody_knows_whether_it_is_still_so_is_said() -> None:
    inventory = Inventory()
    assert doubt_of(ALERT, inventory, 160 * S) == "not known now: r1 is offline, last seen 1 min ago"
    inventory.robot_presence("r1", alive=True)
    doubt = doubt_of(ALERT, inventory, 130 * S)
    assert doubt == "not known now: front is silent, last seen 30 s ago"
    assert alert_row(ALERT, (), 130 * S, may_act=True, doubt=doubt)["doubt"] == doubt
    assert doubt_of(msgspec.structs.replace(ALERT, name=""), inventory, 130 * S) == ""


def test_which_monitor_raises_the_alerts_is_said_as_far_as_it_is_known() -> None:
    assert raised_by("hall-2, process 17").startswith("Another monitor (hall-2, process 17) raises the alerts. ")
    assert raised_by("").startswith("Another monitor raises the alerts. ")


def test_that_nobody_knows_which_alerts_are_open_is_not_that_none_is() -> None:
    assert panel_of(None, []) is Panel.UNKNOWN
    assert panel_of([], []) is Panel.CALM
    assert panel_of(ALERTS, []) is Panel.NOT_FOUND
    assert panel_of(ALERTS, ALERTS[:1]) is Panel.ALERTS


def test_figures_are_of_all_alerts_and_there_is_none_where_nobody_knows() -> None:
    nothing, unknown = dict.fromkeys(Severity, "0"), dict.fromkeys(Severity, NOTHING)
    assert (severity_figures(None), unattended_figure(None)) == (unknown, (NOTHING, ""))
    assert (severity_figures([]), unattended_figure([])) == (nothing, ("0", "of 0"))
    assert severity_figures(ALERTS) == {Severity.INFO: "1", Severity.WARNING: "0", Severity.CRITICAL: "4"}
    assert unattended_figure(ALERTS) == ("4", "of 5")
    assert unattended_figure(ALERTS[:1] * 1_000) == ("1,000", "of 1,000")


def test_an_alert_about_an_object_leads_to_its_page_and_is_found_by_its_id() -> None:
    of_object = msgspec.structs.replace(ALERT, site="hall", object="a/b")
    row = alert_row(of_object, (), 200 * S, may_act=False)
    assert (row["object"], row["href"]) == ("a/b", "/world/hall/a%2Fb")
    assert alert_row(ALERT, (), 200 * S, may_act=False)["href"] == ""
    assert wanted_alerts([ALERT, of_object], None, "A/B") == [of_object]
