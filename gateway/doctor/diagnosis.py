"""From what was seen to what it means, along the way of the data. Pure."""

from collections.abc import Iterator, Sequence

from gateway.doctor.cameras import check_cameras
from gateway.doctor.demand import check_demand, check_recorders
from gateway.doctor.evidence import Evidence
from gateway.doctor.finding import Finding, Severity
from gateway.doctor.frames import check_frames
from gateway.doctor.master import check_host, check_master
from gateway.doctor.presence import check_presence
from gateway.doctor.sensors import check_sensors


def diagnose(evidence: Evidence) -> list[Finding]:
    """Return everything there is to say, in the order of the data's way: master, publishers, gateway, demand."""
    return list(_findings(evidence))


def healthy(findings: Sequence[Finding]) -> bool:
    """Return whether nothing keeps data from flowing or makes it wrong."""
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
