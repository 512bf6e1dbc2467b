"""What the doctor says. Pure."""

from dataclasses import dataclass
from enum import StrEnum


class Severity(StrEnum):
    """How bad it is; a problem keeps data from flowing, or makes it wrong."""

    OK = "ok"
    NOTE = "note"
    PROBLEM = "problem"


class Stage(StrEnum):
    """Where on the way of the data, in that order."""

    MASTER = "ROS master"
    HOST = "this machine"
    SENSORS = "sensors"
    CAMERAS = "colour and depth"
    GATEWAY = "gateway on the bus"
    DEMAND = "demand"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing found. subject: what it is about, such as a stream or an address. advice: what to do, or empty."""

    severity: Severity
    stage: Stage
    subject: str
    what: str
    advice: str = ""


def fine(stage: Stage, subject: str, what: str) -> Finding:
    return Finding(Severity.OK, stage, subject, what)


def note(stage: Stage, subject: str, what: str, advice: str = "") -> Finding:
    return Finding(Severity.NOTE, stage, subject, what, advice)


def problem(stage: Stage, subject: str, what: str, advice: str) -> Finding:
    return Finding(Severity.PROBLEM, stage, subject, what, advice)
