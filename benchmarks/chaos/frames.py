"""What became of every image: made into a class list, or dropped by somebody for a reason. Pure."""

from collections import Counter
from dataclasses import dataclass
from typing import Any, Self

from benchmarks.chaos.observer import FRONT, Seen
from schemas.keys import Stream
from schemas.status import MISSING
from schemas.worker_keys import DETECTOR


@dataclass(frozen=True, slots=True)
class Frames:
    """Images of a time, as processes counted them: one that is killed takes a second of its counts with it.

    received, forwarded, left_out: at gateways, those left out by reason. inferred, dropped: at workers, those dropped
    by reason, without those that never came.
    """

    received: int
    forwarded: int
    left_out: Counter[str]
    inferred: int
    dropped: Counter[str]

    def __sub__(self, before: Self) -> "Frames":
        left_out, dropped = Counter(self.left_out), Counter(self.dropped)
        left_out.subtract(before.left_out)
        dropped.subtract(before.dropped)
        return Frames(
            self.received - before.received,
            self.forwarded - before.forwarded,
            left_out,
            self.inferred - before.inferred,
            dropped,
        )

    def figures(self) -> dict[str, Any]:
        """Return what is printed.

        never_came: those that a gateway forwarded and no worker counted: lost on the link, or with a worker that was
        killed; below 0 are those that a killed gateway had forwarded after its last word. unattributed: those that a
        gateway received, and neither forwarded nor left out; a few are under way.
        """
        drops = {f"at the gateway: {reason}": count for reason, count in self.left_out.items()}
        drops |= {f"at the detector: {reason}": count for reason, count in self.dropped.items()}
        return {
            "received": self.received,
            "inferred": self.inferred,
            "dropped": {reason: count for reason, count in sorted(drops.items()) if count},
            "never_came": self.forwarded - self.inferred - self.dropped.total(),
            "unattributed": self.received - self.forwarded - self.left_out.total(),
        }


def frames(seen: Seen) -> Frames:
    """Add up the last word of every process."""
    left_out, dropped = Counter[str](), Counter[str]()
    received = forwarded = inferred = 0
    for gateway in seen.gateways.values():
        left_out.update(gateway.withdrawn)
        for stream in gateway.streams:
            if stream.camera == FRONT.camera and stream.stream == Stream.COLOR:
                received += stream.received
                forwarded += stream.forwarded
                left_out.update(stream.dropped)
    for (service, _), worker in seen.workers.items():
        for camera in worker.cameras if service == DETECTOR else ():
            inferred += camera.inferred
            dropped.update(camera.dropped)
    dropped.pop(MISSING, None)
    return Frames(received, forwarded, left_out, inferred, dropped)
