"""What keeps gateways from going on. Pure."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from schemas.printing import printable
from schemas.status import GatewayStatus
from services.monitor.natural_order import natural

MAX_SHOWN: Final = 5

NAMESAKES: Final = "has more than one gateway under its name, whose frames get mixed up: end one, or name it otherwise"

THIN_LINK: Final = "has class lists that come more than 2 s late; a thin link needs --uplink-mbit"
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
