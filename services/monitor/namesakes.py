"""Robots under whose name more than one gateway runs: their frames get mixed up. Pure."""

from typing import Final

MOST_PROCESSES: Final = 16
"""How many gateways' processes are remembered of a robot."""

KNOWN_ACCOUNTS: Final = 5
"""After how many accounts of which none shows that there are several it is over; each gateway has one every second."""


class Namesakes:
    """Hears from which process each account of a robot's gateway comes: one that was restarted never comes back."""

    def __init__(self) -> None:
        self._processes: dict[str, tuple[str, ...]] = {}
        self._known: dict[str, int] = {}

    def take(self, robot: str, boot_id: str) -> None:
        """Note an account that arrived."""
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

    def has(self, robot: str) -> bool:
        """Return whether more than one gateway ran under a robot's name lately."""
        return robot in self._known
