"""What keeps gateways from going on, in their own words. Pure."""

from collections.abc import Iterable, Iterator
from typing import Final

from schemas.printing import printable
from schemas.status import GatewayStatus

MAX_SHOWN: Final = 5


def troubles(gateways: Iterable[GatewayStatus]) -> list[str]:
    """Return a line for each thing that a gateway waits for or that is wrong with a stream of it, by robot.

    There are no more than MAX_SHOWN and one that counts the rest.
    """
    every = [printable(line) for status in sorted(gateways, key=lambda status: status.robot) for line in _of(status)]
    rest = [f"and {len(every) - MAX_SHOWN} more problems"] if len(every) > MAX_SHOWN else []
    return [*every[:MAX_SHOWN], *rest]


def _of(status: GatewayStatus) -> Iterator[str]:
    if status.waiting_for:
        yield f"{status.robot} waits for {status.waiting_for}"
    for stream in status.streams:
        if stream.problem:
            yield f"{status.robot} {stream.name}: {stream.problem}"
