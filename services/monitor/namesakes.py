"""Robots under whose name more than one gateway runs: their frames get mixed up. Pure."""

from typing import Final

NS: Final = 1_000_000_000
KNOWN_NS: Final = 5 * NS
"""For how long two gateways are known to run since they were heard in turns."""


class Namesakes:
    """Hears from which process each account of a robot's gateway comes: one that was restarted never comes back."""

    def __init__(self) -> None:
        self._processes: dict[str, tuple[str, str]] = {}
        self._heard_ns: dict[str, int] = {}

    def take(self, robot: str, boot_id: str, at_ns: int) -> None:
        """Note an account that arrived at `at_ns`."""
        newest, before = self._processes.get(robot, (boot_id, ""))
        if boot_id == before:
            self._heard_ns[robot] = at_ns
        if boot_id != newest:
            self._processes[robot] = (boot_id, newest)
        else:
            self._processes.setdefault(robot, (boot_id, ""))

    def has(self, robot: str, at_ns: int) -> bool:
        """Return whether more than one gateway ran under a robot's name shortly before."""
        heard_ns = self._heard_ns.get(robot)
        return heard_ns is not None and at_ns - heard_ns <= KNOWN_NS
