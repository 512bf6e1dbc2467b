"""What became of every image: made into a class list, or dropped by somebody for a reason. Pure."""

from collections import Counter
from dataclasses import dataclass
from typing import Any, Self

from benchmarks.chaos.observer import FRONT, Seen
from schemas.keys import Stream
from schemas.status import GatewayStatus, WorkerStatus
from schemas.worker_keys import DETECTOR
from services.toolbox.demo.summary import drops


@dataclass(frozen=True, slots=True)
class Frames:
    """Images of a time. received: at gateways. inferred: at workers. dropped: by place and reason.

    They are what processes said last: a process that is killed takes a second of its counts with it.
    """

    received: int
    inferred: int
    dropped: Counter[str]

    def __sub__(self, before: Self) -> "Frames":
        dropped = Counter(self.dropped)
        dropped.subtract(before.dropped)
        return Frames(self.received - before.received, self.inferred - before.inferred, dropped)

    @property
    def unattributed(self) -> int:
        """Images of which nobody says what became of them; below 0 are those that were on their way before."""
        return self.received - self.inferred - self.dropped.total()

    def figures(self) -> dict[str, Any]:
        """Return what is printed."""
        return {
            "received": self.received,
            "inferred": self.inferred,
            "dropped": {reason: count for reason, count in sorted(self.dropped.items()) if count},
            "unattributed": self.unattributed,
        }


def frames(seen: Seen) -> Frames:
    """Add up the last word of every process."""
    detectors = [status for (service, _), status in seen.workers.items() if service == DETECTOR]
    gateways = list(seen.gateways.values())
    return Frames(received(gateways), inferred(detectors), drops(gateways, detectors))


def received(gateways: list[GatewayStatus]) -> int:
    """Return how many colour images came to gateways."""
    streams = (stream for gateway in gateways for stream in gateway.streams)
    return sum(of.received for of in streams if of.camera == FRONT.camera and of.stream == Stream.COLOR)


def inferred(detectors: list[WorkerStatus]) -> int:
    """Return of how many there are class lists."""
    return sum(camera.inferred for worker in detectors for camera in worker.cameras)
