"""When a sensor says its messages were made, against the clock they are judged by. Pure."""

from collections.abc import Iterator
from statistics import median
from typing import Final

from gateway.doctor.evidence import Evidence, Heard
from gateway.doctor.finding import Finding, Stage, note, problem

CLOCK: Final = "ros/clock"
LATE_S: Final = 2.0
"""How old a message may be on arrival before its stamps are talked about."""


def check_stamps(subject: str, heard: Heard, evidence: Evidence) -> Iterator[Finding]:
    """Say whether a publisher's stamps are those of now."""
    if not heard.stamps_ns:
        return
    if not any(heard.stamps_ns):
        yield note(
            Stage.SENSORS,
            subject,
            "its stamps are zero: nothing can be matched with it in time",
            "have the driver fill header.stamp",
        )
        return
    if evidence.master.sim_time:
        yield from _check_against_clock(subject, heard, evidence)
        return
    late_s = median(heard.lags_ns) / 1e9
    if abs(late_s) > LATE_S:
        way = "behind" if late_s > 0 else "ahead of"
        yield note(
            Stage.SENSORS,
            subject,
            f"its stamps are {_span(late_s)} {way} this machine's clock",
            "synchronise the clocks (chrony), or set use_sim_time and `rosbag play --clock` if a bag is played",
        )


def _check_against_clock(subject: str, heard: Heard, evidence: Evidence) -> Iterator[Finding]:
    now_ns = sim_now_ns(evidence)
    if now_ns is None:
        return
    late_s = (now_ns - heard.stamps_ns[-1]) / 1e9
    if abs(late_s) > LATE_S + evidence.seconds:
        way = "behind" if late_s > 0 else "ahead of"
        what = f"its stamps are {_span(late_s)} {way} /clock, which use_sim_time makes the time"
        yield note(Stage.SENSORS, subject, what, "do the driver and the simulation or bag use the same clock?")


def check_sim_clock(evidence: Evidence) -> Iterator[Finding]:
    """Say whether the simulation's clock runs."""
    if sim_now_ns(evidence) is None:
        yield problem(
            Stage.SENSORS,
            "/clock",
            "use_sim_time is set, but nothing comes on /clock: time stands still for ROS nodes",
            "start the simulation or `rosbag play --clock`, or `rosparam set use_sim_time false` and restart the nodes",
        )


def sim_now_ns(evidence: Evidence) -> int | None:
    """Return the last time that was heard on /clock."""
    clock = evidence.named(CLOCK)
    return clock.heard.stamps_ns[-1] if clock and clock.heard.stamps_ns else None


def _span(seconds: float) -> str:
    size = abs(seconds)
    for unit, length in (("days", 86_400), ("hours", 3_600), ("minutes", 60)):
        if size >= 2 * length:
            return f"{size / length:.0f} {unit}"
    return f"{size:.1f} s"
