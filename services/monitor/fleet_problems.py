"""Problems of gateways: two of them under one robot's name, and what keeps one from going on. Pure."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from schemas.printing import printable
from schemas.status import GatewayStatus
from services.monitor.formats import natural

MOST_PROCESSES: Final = 16
"""How many gateways' processes are remembered of a robot."""

KNOWN_ACCOUNTS: Final = 5
"""After how many accounts of which none shows that there are several it is over; each gateway has one every second."""


class DuplicateGateways:
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


MAX_SHOWN: Final = 5

NAMESAKES: Final = "has more than one gateway under its name, so their frames are mixed up: stop or rename one"

THIN_LINK: Final = "has class lists that arrive more than 2 s late; on a slow link, set --uplink-mbit"
"""Of all cameras of a robot together: their link is one, and a line that changes is logged again."""


def troubles(problems: Mapping[str, Iterable[str]]) -> list[str]:
    """Return a line for each thing that is wrong with a robot."""
    return [printable(f"{robot} {problem}") for robot in sorted(problems, key=natural) for problem in problems[robot]]


def shortened(lines: Sequence[str], most: int = MAX_SHOWN) -> list[str]:
    """Return no more lines than that, and one that counts the rest."""
    rest = len(lines) - most
    return [*lines[:most], *([f"and {rest} more problem{'s' if rest > 1 else ''}"] if rest > 0 else [])]


def problems_of(gateway: GatewayStatus) -> Iterator[str]:
    """Yield what a gateway waits for, and what is wrong with a stream of it, in its own words."""
    if gateway.waiting_for:
        yield f"waits for {gateway.waiting_for}"
    for stream in gateway.streams:
        if stream.problem:
            yield f"{stream.name}: {stream.problem}"
