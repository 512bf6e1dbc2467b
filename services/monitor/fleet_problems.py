"""Problems of gateways: duplicate gateways of one robot, and reported problems of streams. Pure."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from schemas.printing import printable
from schemas.status import GatewayStatus
from services.monitor.formats import natural

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

    def has(self, robot: str) -> bool:
        """Return whether a robot recently had more than one gateway."""
        return robot in self._known


MAX_SHOWN: Final = 5

NAMESAKES: Final = "has more than one gateway under its name, so their frames are mixed up: stop or rename one"

THIN_LINK: Final = "has class lists that arrive more than 2 s late; on a slow link, set --uplink-mbit"
"""Combines all cameras of a robot: they share one link, and a line that changes is logged again."""


def troubles(problems: Mapping[str, Iterable[str]]) -> list[str]:
    """Return a line for each problem of each robot."""
    return [printable(f"{robot} {problem}") for robot in sorted(problems, key=natural) for problem in problems[robot]]


def shortened(lines: Sequence[str], most: int = MAX_SHOWN) -> list[str]:
    """Return at most `most` lines, plus one that counts the rest."""
    rest = len(lines) - most
    return [*lines[:most], *([f"and {rest} more problem{'s' if rest > 1 else ''}"] if rest > 0 else [])]


def problems_of(gateway: GatewayStatus) -> Iterator[str]:
    """Yield the missing dependency and the stream problems of a gateway, in its own words."""
    if gateway.waiting_for:
        yield f"waits for {gateway.waiting_for}"
    for stream in gateway.streams:
        if stream.problem:
            yield f"{stream.name}: {stream.problem}"
