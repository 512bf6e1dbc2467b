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
    by_robot = sorted(gateways, key=lambda status: status.robot)
    every = [printable(f"{status.robot} {problem}") for status in by_robot for problem in problems_of(status)]
    rest = [f"and {len(every) - MAX_SHOWN} more problems"] if len(every) > MAX_SHOWN else []
    return [*every[:MAX_SHOWN], *rest]


def problems_of(gateway: GatewayStatus) -> Iterator[str]:
    """Yield what is wrong with a robot, in its gateway's words."""
    if gateway.waiting_for:
        yield f"waits for {gateway.waiting_for}"
    for stream in gateway.streams:
        if stream.problem:
            yield f"{stream.name}: {stream.problem}"
