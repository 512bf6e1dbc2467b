"""5,000 robots' class lists to one monitor process, which is their router too, in about three minutes.

The robots are four other processes with ten sessions each, so that one session has as many robots as a busy detector
worker has cameras; `--robots` and `--sessions` have more of both. Each robot and camera is present and each class list
published as gateways and detectors do it. Gateways' statuses, one a second, are left out. The monitor is `fleetsight
monitor` as it is started: the router that everybody connects to is in the same process, and its history is in SQLite;
there are three rules.

    lost              class lists that were sent less those the monitor says, in an answer about its inventory, it took
                      in, two seconds after the last; every list counts once, so that doubles hide no loss
    p99_ms            from putting a list on the bus until an answer about the inventory shows it, the answer's way
                      included; of one more camera, twenty times a second, amid the others
    page_p95_ms       a whole answer of the page or of the API, the slowest of three addresses fetched in turn,
                      meanwhile, that is with 5,000 robots
    rss_mb            resident memory of the monitor after that
    max_msgs_per_s    the highest rate at which nothing was lost; max_is_publishers: the publishers could not send more
    cpu_share_1000x5  processor time of the monitor, of one core, with 1,000 robots at 5 lists a second, while nobody
                      looks at its page or asks it anything
    sessions          Zenoh sessions that the robots share

All processes share the machine's cores.
"""

import asyncio
import signal
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.arguments import parser_of, show
from benchmarks.gateway.processes import PeerError
from benchmarks.machine import machine, versions
from benchmarks.monitor.report import targets
from benchmarks.monitor.scenario import PUBLISHERS, Scenario, scenario
from benchmarks.progress import note

ROBOTS: Final = 5_000
SESSIONS: Final = 40
HZ: Final = 2.0
FEWER: Final = 1_000
FASTER_HZ: Final = 5.0
STEPS_HZ: Final = (0.5, 1.0, 1.5, 2.5, 3.0, 4.0, 5.0, 6.0)
STEP_S: Final = 6.0
BEHIND_MS: Final = 1_000.0
"""A publisher that is so late does not send what it should."""


@dataclass(frozen=True, slots=True)
class Fleet:
    """How many robots there are, and how many sessions they share."""

    robots: int
    sessions: int


def main() -> None:
    """Measure and print."""
    parser = parser_of("benchmarks.monitor", __doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="length of one measurement (default: 30)")
    parser.add_argument("--robots", type=int, default=ROBOTS, help=f"how many robots (default: {ROBOTS})")
    parser.add_argument("--sessions", type=int, default=SESSIONS, help=f"how many share them (default: {SESSIONS})")
    parser.add_argument("--router-apart", action="store_true", help="the router is a process of its own")
    arguments = parser.parse_args()
    if arguments.robots < FEWER or arguments.robots % PUBLISHERS:
        parser.error(f"--robots {arguments.robots}: not a multiple of {PUBLISHERS}, {FEWER} or more")
    if arguments.sessions < PUBLISHERS or arguments.sessions % PUBLISHERS:
        parser.error(f"--sessions {arguments.sessions}: not a multiple of {PUBLISHERS}")
    fleet = Fleet(arguments.robots, arguments.sessions)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended by a signal"))
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = asyncio.run(measure(Path(folder), fleet, arguments.seconds, apart=arguments.router_apart))
        except* PeerError as failed:
            sys.exit("\n".join(causes(failed)))
    show(found, as_json=arguments.json)


def causes(failed: BaseException) -> list[str]:
    """Return what went wrong, each once."""
    if isinstance(failed, BaseExceptionGroup):
        return list(dict.fromkeys(cause for each in failed.exceptions for cause in causes(each)))
    return [str(failed)]


async def measure(folder: Path, fleet: Fleet, seconds: float, *, apart: bool) -> dict[str, Any]:
    """Do everything."""
    async with scenario(folder, fleet.robots, fleet.sessions, apart=apart) as running:
        note(f"{FEWER} robots")
        await running.robots(FEWER)
        fewer = await running.send(FASTER_HZ, seconds / 2)
        note(f"{fewer.figures()}\n{fleet.robots} robots")
        await running.robots(fleet.robots)
        flow = await running.send(HZ, seconds, watched=True)
        found = flow.figures() | {
            "rss_mb": round(running.monitor.rss_bytes() / 2**20),
            "cpu_share_1000x5": round(fewer.cpu_share, 3),
            "lost_1000x5": fewer.lost,
        }
        note(f"{found}\nfaster and faster")
        found |= await highest(running)
    return {
        "targets": targets(found),
        **found,
        "robots": fleet.robots,
        "hz": HZ,
        "sessions": fleet.sessions,
        "seconds": seconds,
        "router_apart": apart,
        "machine": machine(),
        "versions": versions(["eclipse-zenoh", "msgspec"]),
    }


async def highest(fleet: Scenario) -> dict[str, Any]:
    """Return the highest rate without loss."""
    best = 0
    for hz in STEPS_HZ:
        flow = await fleet.send(hz, STEP_S)
        note(f"{hz} Hz: {flow.figures()}")
        if flow.lost:
            return {"max_msgs_per_s": best, "max_is_publishers": False}
        best = max(best, round(flow.sent_per_s))
        if flow.late_ms > BEHIND_MS:
            break
    return {"max_msgs_per_s": best, "max_is_publishers": True}


if __name__ == "__main__":
    main()
