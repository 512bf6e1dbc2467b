"""Bytes, time and memory that robots cost their router, with thousands of real sessions, in some five minutes.

Every robot is a session of its own and declares what a gateway declares; no images flow. A few processes have them
all, the router is a process apart, and a client of it watches the whole fleet, as a monitor does. One more robot joins
by way of a relay that counts what crosses it. `beside` has the same of robots to which services beside them connect,
which declare every stream by itself.

    bytes_per_robot_joining  both ways, without signs of life, beside so many robots, the median of three;
                             joining_spread: the most over the least
    router_kb_per_robot      resident memory of the router at the most robots, over that without robots
    declarations             of one robot, as a router lists them, and its watch of others' tokens
    restart_s                from the start of another router, after the first was killed, until the client sees every
                             robot and stream again; null, and restart_missing, if not within a minute
    curve                    the same by the number of robots
"""

import argparse
import asyncio
import os
import signal
import statistics
import sys
from typing import Any, Final

from benchmarks.arguments import at_least_one, parser_of, show
from benchmarks.machine import machine, versions
from benchmarks.scale.declarations import declarations
from benchmarks.scale.fleet import Fleet, Kind, fleet
from benchmarks.targets import at_most

JOINING: Final = (10, 50, 200)
JOINS: Final = 3
SPREAD: Final = 1.2
RESTART_S: Final = 20
RESTARTED: Final = (200, 1_000)
"""Robots with which the router is restarted, as it is with the most; restart_s is that one."""

BESIDE: Final = 500
"""Robots with services beside them, at most: with twice as many, links count as lost before all are back."""

KB_PER_ROBOT: Final = 150
DECLARATIONS: Final = 8


def main() -> None:
    """Measure and print."""
    parser = parser_of("benchmarks.scale", __doc__)
    parser.add_argument("--robots", type=at_least_one, default=1_000, help="how many at last (default: 1000)")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended by a signal"))
    show(asyncio.run(measure(arguments)), as_json=arguments.json)


async def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Have more and more robots, of one kind and then of the other."""
    load = os.getloadavg()[0]
    found = await _kind("alone", arguments.robots)
    limits = {
        "joining_spread": SPREAD,
        "restart_s": RESTART_S,
        "router_kb_per_robot": KB_PER_ROBOT,
        "declarations_per_robot": DECLARATIONS,
    }
    return {
        "targets": {
            name: target for each, most in limits.items() for name, target in at_most(found, each, most).items()
        },
        **found,
        "beside": await _kind("beside", min(arguments.robots, BESIDE)),
        "load_average": {"before": round(load, 1), "after": round(os.getloadavg()[0], 1)},
        "machine": machine(),
        "versions": versions(["eclipse-zenoh", "msgspec"]),
    }


async def _kind(kind: Kind, most: int) -> dict[str, Any]:
    steps = sorted({each for each in (*JOINING, 500, 1_000) if each < most} | {most})
    declared = await asyncio.to_thread(declarations, kind)
    async with fleet(kind) as robots:
        curve = [await _step(robots, number, last=number == steps[-1]) for number in steps]
    joining = {str(each["robots"]): each["bytes_joining"] for each in curve if each["robots"] in JOINING}
    return {
        "bytes_per_robot_joining": joining,
        "joining_spread": round(max(joining.values()) / min(joining.values()), 2) if joining else None,
        "router_kb_per_robot": curve[-1]["router_kb_per_robot"],
        "declarations_per_robot": sum(declared.values()),
        "declarations": declared,
        **{name: value for name, value in curve[-1].items() if name.startswith("restart_")},
        "robots": most,
        "curve": curve,
    }


async def _step(robots: Fleet, number: int, *, last: bool) -> dict[str, Any]:
    coming = await robots.grow(number)
    joined = [await robots.join() for _ in range(JOINS)]
    found = {"robots": number, **coming, "bytes_joining": statistics.median(joined), "bytes_joining_each": joined}
    return found | (await robots.restart() if last or number in RESTARTED else {})


if __name__ == "__main__":
    main()
