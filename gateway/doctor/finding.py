"""Findings of the doctor. Pure."""

from dataclasses import dataclass
from enum import StrEnum


class Severity(StrEnum):
    """Severity of a finding; a problem stops data or makes it wrong."""

    OK = "ok"
    NOTE = "note"
    PROBLEM = "problem"


class Stage(StrEnum):
    """Stage of the data path, in order."""

    MASTER = "ROS master"
    HOST = "this machine"
    SENSORS = "sensors"
    CAMERAS = "colour and depth"
    GATEWAY = "gateway on the bus"
    DEMAND = "demand"


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding. subject: a stream or an address, for instance. advice: the remedy, or empty."""

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
