"""The demo's summary: the outcome of every frame of the run. Pure."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from schemas.keys import Stream
from schemas.status import MISSING, NUMBERED, GatewayStatus, WorkerStatus
from services.monitor.fleet import Fleet
from services.toolbox.demo.processors import ProcessorUse


@dataclass(frozen=True, slots=True)
class Summary:
    """Counts of one run.

    robots: those that should have been seen. sent: frames per robot as its camera counted them. lists: class lists per
    robot as the monitor counted them. dropped: frames by place and reason. ages_s: from a frame's arrival at its
    gateway to its class list's at the monitor. first_list_s: from the start of the demo. processors: of this machine,
    if the system tells.
    """

    robots: Sequence[str]
    sent: Mapping[str, int]
    inferred: int
    dropped: Mapping[str, int]
    lists: Mapping[str, int]
    ages_s: Sequence[float]
    first_list_s: float | None
    processors: ProcessorUse | None = None

    @classmethod
    def of(
        cls,
        fleet: Fleet,
        robots: Sequence[str],
        sent: Mapping[str, int],
        began_s: float,
        processors: ProcessorUse | None = None,
    ) -> Self:
        """Return the outcome of a run that began at a monotonic time, as a monitor saw it."""
        detectors = [worker for (service, _), worker in fleet.workers.items() if service == "detector"]
        return cls(
            robots=robots,
            sent=sent,
            inferred=sum(camera.inferred for worker in detectors for camera in worker.cameras),
            dropped=drops(fleet.gateways.values(), detectors),
            lists=fleet.lists_per_robot(),
            ages_s=tuple(fleet.ages_s),
            first_list_s=None if fleet.first_list_s is None else fleet.first_list_s - began_s,
            processors=processors,
        )

    @property
    def complete(self) -> bool:
        """Whether every robot's class lists arrived."""
        return not self._unseen()

    def _unseen(self) -> list[str]:
        return [robot for robot in self.robots if not self.lists.get(robot)]

    def lines(self) -> list[str]:
        """Return the lines of the printed summary."""
        ages = sorted(self.ages_s)
        lost = ", ".join(f"{count} {reason}" for reason, count in sorted(self.dropped.items())) or "none"
        under_way = sum(self.sent.values()) - self.inferred - sum(self.dropped.values())
        missing = ", ".join(self._unseen())
        return [
            f"frames sent:          {sum(self.sent.values())} ({_per_robot(self.sent)})",
            f"frames inferred:      {self.inferred}",
            f"frames dropped:       {lost}",
            f"frames under way:     {max(0, under_way)} when it was stopped",
            f"class lists received: {sum(self.lists.values())} ({_per_robot(self.lists)})",
            f"first class list:     {_seconds(self.first_list_s)} after the start",
            f"age p50 / p99:        {_seconds(percentile(ages, 50))} / {_seconds(percentile(ages, 99))}",
            *([] if self.processors is None else [f"machine:              {self.processors}"]),
            f"result:               {f'no class list from {missing}' if missing else 'every robot was seen'}",
        ]


def drops(gateways: Iterable[GatewayStatus], workers: Iterable[WorkerStatus]) -> Counter[str]:
    """Sum up every dropped image once, under "place: reason". workers: the detectors."""
    at_gateways: Counter[str] = Counter()
    at_workers: Counter[str] = Counter()
    for gateway in gateways:
        at_gateways.update(gateway.withdrawn)
        for stream in gateway.streams:
            if stream.stream == Stream.COLOR:
                at_gateways.update(stream.dropped)
    for worker in workers:
        for camera in worker.cameras:
            at_workers.update(camera.dropped)
    # Frames that a gateway numbered and dropped are missing at the worker too; the link lost the others missing there.
    missing = at_workers.pop(MISSING, 0)
    places = {"at the gateway": at_gateways, "at the detector": at_workers}
    counts = Counter({f"{place}: {reason}": n for place, drops in places.items() for reason, n in drops.items()})
    counts["on the link: lost"] = max(0, missing - sum(at_gateways[reason] for reason in NUMBERED))
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
