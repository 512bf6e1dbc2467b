"""Finds robots that have more than one gateway under their name, and cameras with two senders. Pure."""

from typing import Final

import msgspec

from schemas.detections import ClassList
from schemas.keys import CameraKey

MOST_PROCESSES: Final = 16
"""Maximum number of gateway processes remembered per robot."""

KNOWN_ACCOUNTS: Final = 5
"""Status messages without a sign of a duplicate after which it counts as gone; each gateway sends one a second."""


class DuplicateGateways:
    """Tracks gateway processes by robot: a process that was replaced by a restart never returns."""

    def __init__(self) -> None:
        self._processes: dict[str, tuple[str, ...]] = {}
        self._known: dict[str, int] = {}

    def take(self, robot: str, boot_id: str) -> None:
        """Note the process of a status message."""
        processes = self._processes.get(robot, ())
        if boot_id in processes[1:]:
            self._known[robot] = KNOWN_ACCOUNTS
        elif self._known.get(robot, 0) > 1:
            self._known[robot] -= 1
        else:
            self._known.pop(robot, None)
        if processes[:1] != (boot_id,):
            others = (each for each in processes if each != boot_id)
            self._processes[robot] = (boot_id, *others)[:MOST_PROCESSES]

    def forget(self, robot: str) -> None:
        """Forget a robot."""
        self._processes.pop(robot, None)
        self._known.pop(robot, None)

    def robots(self) -> list[str]:
        """Return the robots that recently had more than one gateway."""
        return sorted(self._known)

    def has(self, robot: str) -> bool:
        """Return whether a robot recently had more than one gateway."""
        return robot in self._known


DUPLICATE_GATEWAY: Final = "has more than one gateway under its name, so their frames are mixed up: stop or rename one"


TAKEOVER_NS: Final = 10_000_000_000
"""Time for which two workers may serve one camera: one that takes over begins before the other ends."""

PAUSE_NS: Final = 3_000_000_000
"""Time without a list of the other worker after which one of them has it alone."""

SHOWN_NS: Final = 60_000_000_000


class _Turns(msgspec.Struct):
    worker: str
    model: str
    other: str = ""
    since_ns: int = 0
    last_ns: int = 0
    found_ns: int = 0


class RivalSenders:
    """Finds cameras whose class lists two senders send by turns, of one model, for longer than takeovers take."""

    def __init__(self) -> None:
        self._turns: dict[CameraKey, _Turns] = {}

    def take(self, key: CameraKey, seen: ClassList, now_ns: int) -> None:
        """Note who sent a list."""
        turns = self._turns.get(key)
        if turns is None or turns.model != seen.model:
            self._turns[key] = _Turns(seen.worker, seen.model)
        elif turns.worker != seen.worker:
            if seen.worker != turns.other or not 0 <= now_ns - turns.last_ns <= PAUSE_NS:
                turns.since_ns = now_ns
            turns.worker, turns.other, turns.last_ns = seen.worker, turns.worker, now_ns
            if now_ns - turns.since_ns >= TAKEOVER_NS:
                turns.found_ns = now_ns

    def forget(self, key: CameraKey) -> None:
        """Forget a camera."""
        self._turns.pop(key, None)

    def found(self, now_ns: int) -> dict[CameraKey, tuple[str, str]]:
        """Return the cameras with two senders lately, and both names."""
        return {
            key: (min(turns.worker, turns.other), max(turns.worker, turns.other))
            for key, turns in self._turns.items()
            if turns.found_ns and 0 <= now_ns - turns.found_ns <= SHOWN_NS
        }
