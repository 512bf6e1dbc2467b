"""Alerts and actions: messages of the fleet's rules to people and robots."""

from enum import StrEnum
from typing import Annotated, Final

import msgspec

from schemas.header import Label, MaybeName, Name, Nanoseconds

MAX_TEXT: Final = 4_096
MAX_PAYLOAD: Final = 64 * 1024

Id = Annotated[str, msgspec.Meta(min_length=1, max_length=64)]


class Severity(StrEnum):
    """The urgency of an alert.

    >>> fleetsight.Severity("critical") is fleetsight.Severity.CRITICAL
    True
    """

    INFO = "info"
    WARNING = "warning"
    CRITICAL = "critical"


class AlertState(StrEnum):
    """The state of an alert.

    >>> [state.value for state in fleetsight.AlertState]
    ['raised', 'acknowledged', 'escalated', 'resolved']
    """

    RAISED = "raised"
    ACKNOWLEDGED = "acknowledged"
    ESCALATED = "escalated"
    RESOLVED = "resolved"


class Alert(msgspec.Struct, frozen=True, kw_only=True):
    """The current state of an alert; sent again with the same id and a later changed_ns on each change.

    rule: the rule that raised it. robot, camera, name: the robot, the camera and the class of objects it is about; each
    is empty where there is none. Alerts without a robot are about a site, and are not sent to robots. text: for people.
    site, object: the site, and the id of the one object of it, that it is about; empty where there is none.
    link: the address of the object's page, without a host where the monitor does not know its own (`--web-url`).
    raised_ns, changed_ns: nanoseconds since the epoch on the monitor's system clock.

    >>> alert = fleetsight.Alert(
    ...     id="a1", rule="too near", severity=fleetsight.Severity.CRITICAL, state=fleetsight.AlertState.RAISED,
    ...     robot="r1", camera="front", name="forklift", text="a forklift is nearer than 2 m",
    ...     raised_ns=1_700_000_000_000_000_000, changed_ns=1_700_000_000_000_000_000,
    ... )
    >>> f"{alert.severity} {alert.state}: {alert.robot}: {alert.text}"
    'critical raised: r1: a forklift is nearer than 2 m'
    """

    id: Id
    rule: Label
    severity: Severity
    state: AlertState
    robot: MaybeName
    camera: MaybeName = ""
    name: Label = ""
    site: MaybeName = ""
    object: Annotated[str, msgspec.Meta(max_length=64)] = ""
    link: Annotated[str, msgspec.Meta(max_length=MAX_TEXT)] = ""
    text: Annotated[str, msgspec.Meta(max_length=MAX_TEXT)]
    raised_ns: Nanoseconds
    changed_ns: Nanoseconds


class Action(msgspec.Struct, frozen=True, kw_only=True):
    """An action for a robot to perform once; the robot's own settings decide which actions it accepts.

    id: of this one time. name: what is to be done, such as pick_up. payload: what the robot is told, whole.
    rule: the rule that asks for it; empty where a person does. sent_ns: since the epoch on the sender's system clock.
    robot_ns: the same moment on the robot's, as far as the sender has measured that clock; 0 if it has not.
    """

    id: Id
    name: Name
    robot: Name
    payload: Annotated[str, msgspec.Meta(max_length=MAX_PAYLOAD)] = ""
    rule: Label = ""
    sent_ns: Nanoseconds
    robot_ns: Nanoseconds = 0
