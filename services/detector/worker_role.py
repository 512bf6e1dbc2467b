"""Roles of a worker: primary, whose results count, or opinion, which only gives a second opinion. Pure."""

from dataclasses import dataclass
from typing import Final

from schemas import worker_keys
from schemas.keys import Stream

LONGEST_NAME: Final = 64


@dataclass(frozen=True, slots=True)
class WorkerRole:
    """The service name of a worker, and the results it makes.

    service: its name in the keys of workers; cameras are shared with workers of the same alone. lists: the stream of
    its class lists. lists_only: it makes nothing else of a camera, and answers no images.
    most_hz: about how many frames a second of a camera it asks for at most and looks at, None for all that it can.
    prefix: of its name as a consumer of frames.
    """

    service: str
    lists: Stream
    lists_only: bool = False
    most_hz: float | None = None
    prefix: str = ""

    def consumer(self, worker: str) -> str:
        """Return the name under which a worker asks gateways for frames: a detector beside it may have the same name.

        No detector's own name begins with another role's prefix; see `DetectorSettings`.
        """
        return self.prefix + worker[-(LONGEST_NAME - len(self.prefix)) :]


DETECTOR: Final = WorkerRole(worker_keys.DETECTOR, Stream.CLASSES)

OPINION: Final = WorkerRole(worker_keys.OPINION, Stream.OPINION, lists_only=True, most_hz=2.0, prefix="opinion.")
"""A rate that is enough for counts to settle, and leaves most of the machine to a detector on it."""
