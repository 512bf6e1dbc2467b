"""Reports the findings as text and as JSON. Pure."""

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from itertools import groupby
from typing import Final

import msgspec

from gateway.doctor.cameras import check_cameras
from gateway.doctor.demand import check_demand, check_recorders
from gateway.doctor.evidence import Evidence
from gateway.doctor.finding import Finding, Severity
from gateway.doctor.frames import check_frames
from gateway.doctor.master import check_host, check_master
from gateway.doctor.presence import check_presence
from gateway.doctor.sensors import check_sensors
from schemas.printing import printable


def diagnose(evidence: Evidence) -> list[Finding]:
    """Return all findings in the order of the data path: master, publishers, gateway, demand."""
    return list(_findings(evidence))


def healthy(findings: Sequence[Finding]) -> bool:
    """Return whether there is no problem among the findings."""
    return not any(finding.severity is Severity.PROBLEM for finding in findings)


def _findings(evidence: Evidence) -> Iterator[Finding]:
    yield from check_master(evidence.master)
    yield from check_host(evidence.host, remote_master=evidence.master.remote)
    yield from check_sensors(evidence)
    yield from check_cameras(evidence)
    yield from check_frames(evidence)
    yield from check_presence(evidence)
    yield from check_demand(evidence)
    yield from check_recorders(evidence)


_INDENT: Final = 11
_ADVICE: Final = "-> "


def as_json(findings: Sequence[Finding]) -> str:
    """Return the overall result and the findings as one JSON object."""
    report = {"ok": healthy(findings), "findings": [asdict(finding) for finding in findings]}
    return msgspec.json.format(msgspec.json.encode(report)).decode()


def as_text(findings: Sequence[Finding], width: int) -> str:
    """Return lines of at most `width` characters where words allow it; problems are in capitals."""
    return "\n".join(_lines(findings, max(width, 40)))


def _lines(findings: Sequence[Finding], width: int) -> Iterator[str]:
    for stage, group in groupby(findings, key=lambda finding: finding.stage):
        yield str(stage)
        for alike, several in groupby(group, key=lambda finding: replace(finding, subject="")):
            subjects = ", ".join(finding.subject for finding in several)
            yield from _finding(replace(alike, subject=subjects), width)
        yield ""
    yield _summary(findings)


def _finding(finding: Finding, width: int) -> Iterator[str]:
    severity = finding.severity.upper() if finding.severity is Severity.PROBLEM else str(finding.severity)
    yield from _wrapped(f"{finding.subject}: {finding.what}", f"  {severity}", width)
    if finding.advice:
        yield from _wrapped(_ADVICE + finding.advice, "", width, hanging=len(_ADVICE))


def _wrapped(text: str, head: str, width: int, hanging: int = 0) -> list[str]:
    return textwrap.wrap(
        printable(text),
        width,
        initial_indent=head.ljust(_INDENT),
        subsequent_indent=" " * (_INDENT + hanging),
        break_long_words=False,
        break_on_hyphens=False,
    )


def _summary(findings: Sequence[Finding]) -> str:
    problems = [finding for finding in findings if finding.severity is Severity.PROBLEM]
    if not problems:
        return "No problems found: every stream that is wanted can flow."
    number = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
    return printable(f"{number}; the first to solve: {problems[0].subject}: {problems[0].what}")
