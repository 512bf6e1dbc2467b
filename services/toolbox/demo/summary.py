"""The demo's last words: what every frame of the run came to. Pure."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from schemas.status import GatewayStatus, WorkerStatus


@dataclass(frozen=True, slots=True)
class Summary:
    """Counts of one run.

    robots: those that should have been seen. sent: frames per robot as its camera counted them. lists: class lists per
    robot as the monitor counted them. dropped: frames by place and reason. ages_s: from a frame's arrival at its
    gateway to its class list's at the monitor. first_list_s: from the start of the demo.
    """

    robots: Sequence[str]
    sent: Mapping[str, int]
    inferred: int
    dropped: Mapping[str, int]
    lists: Mapping[str, int]
    ages_s: Sequence[float]
    first_list_s: float | None

    @property
    def complete(self) -> bool:
        """Whether every robot's class lists arrived."""
        return not self._unseen()

    def _unseen(self) -> list[str]:
        return [robot for robot in self.robots if not self.lists.get(robot)]

    def lines(self) -> list[str]:
        """Return the summary as it is printed."""
        ages = sorted(self.ages_s)
        lost = ", ".join(f"{count} {reason}" for reason, count in sorted(self.dropped.items())) or "none"
        missing = ", ".join(self._unseen())
        return [
            f"frames sent:          {sum(self.sent.values())} ({_per_robot(self.sent)})",
            f"frames inferred:      {self.inferred}",
            f"frames dropped:       {lost}",
            f"class lists received: {sum(self.lists.values())} ({_per_robot(self.lists)})",
            f"first class list:     {_seconds(self.first_list_s)} after the start",
            f"age p50 / p99:        {_seconds(percentile(ages, 50))} / {_seconds(percentile(ages, 99))}",
            f"result:               {f'no class list from {missing}' if missing else 'every robot was seen'}",
        ]


def drops(gateways: Iterable[GatewayStatus], workers: Iterable[WorkerStatus]) -> Counter[str]:
    """Add up every drop under "place: reason"."""
    counts: Counter[str] = Counter()
    for gateway in gateways:
        for stream in gateway.streams:
            counts.update({f"at the gateway: {reason}": count for reason, count in stream.dropped.items()})
    for worker in workers:
        for camera in worker.cameras:
            counts.update({f"at the {worker.service}: {reason}": count for reason, count in camera.dropped.items()})
    return +counts


def percentile(ordered: Sequence[float], percent: int) -> float | None:
    """Return the nearest-rank percentile of ascending values, None of none."""
    if not ordered:
        return None
    return ordered[max(0, -(-len(ordered) * percent // 100) - 1)]


def _per_robot(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{robot} {count}" for robot, count in sorted(counts.items())) or "no robots"


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} s"
