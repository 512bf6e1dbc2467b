"""5,000 robots' class lists to one monitor process, which is their router too, in about three minutes.

The robots are four other processes with ten sessions each, so that one session has as many robots as a busy detector
worker has cameras; each robot and camera is present and each class list published as gateways and detectors do it.
Gateways' statuses, one a second, are left out. The monitor is `fleetsight monitor` as it is started: the router that
everybody connects to is in the same process, and its history is in SQLite; there are three rules.

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
from pathlib import Path
from typing import Any, Final

from benchmarks.arguments import parser_of, show
from benchmarks.gateway.processes import PeerError
from benchmarks.machine import machine, versions
from benchmarks.monitor.report import targets
from benchmarks.monitor.scenario import PUBLISHERS, SESSIONS, Scenario, scenario
from benchmarks.progress import note

ROBOTS: Final = 5_000
HZ: Final = 2.0
FEWER: Final = 1_000
FASTER_HZ: Final = 5.0
STEPS_HZ: Final = (0.5, 1.0, 1.5, 2.5, 3.0, 4.0, 5.0, 6.0)
STEP_S: Final = 6.0
BEHIND_MS: Final = 1_000.0
"""A publisher that is so late does not send what it should."""


def main() -> None:
    """Measure and print."""
    parser = parser_of("benchmarks.monitor", __doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="length of one measurement (default: 30)")
    parser.add_argument("--router-apart", action="store_true", help="the router is a process of its own")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended by a signal"))
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = asyncio.run(measure(Path(folder), arguments.seconds, apart=arguments.router_apart))
        except* PeerError as failed:
            sys.exit("\n".join(causes(failed)))
    show(found, as_json=arguments.json)


def causes(failed: BaseException) -> list[str]:
    """Return what went wrong, each once."""
    if isinstance(failed, BaseExceptionGroup):
        return list(dict.fromkeys(cause for each in failed.exceptions for cause in causes(each)))
    return [str(failed)]


async def measure(folder: Path, seconds: float, *, apart: bool) -> dict[str, Any]:
    """Do everything."""
    async with scenario(folder, ROBOTS, apart=apart) as fleet:
        note(f"{FEWER} robots")
        await fleet.robots(FEWER)
        fewer = await fleet.send(FASTER_HZ, seconds / 2)
        note(f"{fewer.figures()}\n{ROBOTS} robots")
        await fleet.robots(ROBOTS)
        flow = await fleet.send(HZ, seconds, watched=True)
        found = flow.figures() | {
            "rss_mb": round(fleet.monitor.rss_bytes() / 2**20),
            "cpu_share_1000x5": round(fewer.cpu_share, 3),
            "lost_1000x5": fewer.lost,
        }
        note(f"{found}\nfaster and faster")
        found |= await highest(fleet)
    return {
        "targets": targets(found),
        **found,
        "robots": ROBOTS,
        "hz": HZ,
        "sessions": PUBLISHERS * SESSIONS,
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
