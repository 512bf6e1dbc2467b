from dataclasses import replace

import pytest

from gateway.doctor.evidence import Evidence, Heard, MasterLook, StreamLook
from gateway.doctor.finding import Finding, Severity
from gateway.doctor.sensors import check_sensors
from tests.gateway.doctor.seeing import IMAGE, NOW_NS, evidence, graph_of, heard, publisher, stream


def camera(said: Heard) -> StreamLook:
    return stream("front/color", "/front/color/image_raw", IMAGE, publisher(IMAGE, said))


def notes(seen: Evidence) -> list[Finding]:
    return [each for each in check_sensors(seen) if each.severity is not Severity.OK]


@pytest.mark.parametrize("late_ms", [-2000, 0, 2000])
def test_stamps_near_this_machines_clock(late_ms: int) -> None:
    assert notes(evidence(camera(heard(late_ms=late_ms)))) == []


@pytest.mark.parametrize(
    ("late_ms", "what"),
    [
        (2001, "2.0 s behind this machine's clock"),
        (-60_000, "60.0 s ahead of this machine's clock"),
        (120_000, "2 minutes behind"),
        (7_200_000, "2 hours behind"),
        (3 * 86_400_000, "3 days behind"),
    ],
)
def test_stamps_far_from_this_machines_clock(late_ms: int, what: str) -> None:
    (finding,) = notes(evidence(camera(heard(late_ms=late_ms))))
    assert finding.severity is Severity.NOTE
    assert what in finding.what
    assert "chrony" in finding.advice


def test_stamps_of_zero() -> None:
    (finding,) = notes(evidence(camera(replace(heard(), stamps_ns=(0,) * 5))))
    assert "stamps are zero" in finding.what


def test_types_without_a_stamp() -> None:
    assert notes(evidence(camera(replace(heard(), stamps_ns=(), lags_ns=())))) == []


def simulated(look: StreamLook, clock_ns: int | None) -> Evidence:
    said = Heard((0.0,), 8, (clock_ns,), (0,)) if clock_ns is not None else Heard()
    clock = stream("ros/clock", "/clock", "rosgraph_msgs/Clock", publisher("rosgraph_msgs/Clock", said))
    master = MasterLook("http://robot:11311", None, graph_of(look, clock), sim_time=True)
    return evidence(look, beside=(clock,), master=master)


LAST_NS = NOW_NS + 400_000_000


def test_under_simulated_time_stamps_are_judged_by_its_clock_alone() -> None:
    assert notes(simulated(camera(heard(late_ms=3_600_000)), LAST_NS)) == []


@pytest.mark.parametrize(("off_s", "said"), [(5, False), (5.1, True), (-5.1, True)])
def test_stamps_far_from_the_simulated_clock(off_s: float, *, said: bool) -> None:
    found = notes(simulated(camera(heard()), LAST_NS + int(off_s * 1e9)))
    assert len(found) == said
    assert all("/clock" in each.what for each in found)


def test_a_simulated_clock_that_stands_still() -> None:
    (finding,) = notes(simulated(camera(heard()), None))
    assert (finding.severity, finding.subject) == (Severity.PROBLEM, "/clock")
