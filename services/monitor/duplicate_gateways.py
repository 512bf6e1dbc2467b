"""Finds robots that have more than one gateway under their name. Pure."""

from typing import Final

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

    def has(self, robot: str) -> bool:
        """Return whether a robot recently had more than one gateway."""
        return robot in self._known


DUPLICATE_GATEWAY: Final = "has more than one gateway under its name, so their frames are mixed up: stop or rename one"
