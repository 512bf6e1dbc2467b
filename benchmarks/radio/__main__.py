"""What becomes of a robot's class lists on a poor radio link: a real gateway, router and worker, in about 2 minutes.

The link is a relay of TCP connections, which is thin, or carries nothing for a while. The robot is simulated, its
colour images are 640x480 at 5 Hz as JPEG; the model is a stand-in that takes 20 ms. Ages are from when the gateway had
a frame to when its class list arrived.

    thin_*           on a link that carries less than the images are, without --uplink-mbit
    budget_*         the same with --uplink-mbit, a tenth less than the link carries
    back_s           a link that carried nothing for longer than Zenoh waits carries again: how long until class lists
                     of new frames come, at most
    stalled_back_s   the same where it was for less than Zenoh waits
"""

import argparse
import asyncio
import json
import signal
import sys
import time
from typing import Any, Final

from benchmarks.machine import machine, versions
from benchmarks.monitor.report import percentile
from benchmarks.progress import note
from benchmarks.radio.scenario import HZ, SEED, Place, place
from benchmarks.targets import at_most
from bus import BusSettings

THIN_MBIT: Final = 1.0
GOOD_MBIT: Final = 20.0
BUDGET: Final = 0.9
LEASE_S: Final = BusSettings().lease_s
GONE_S: Final = 3 * LEASE_S
STALLED_S: Final = LEASE_S / 2
OUTAGES: Final = 3
BETWEEN_S: Final = 5.0


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.radio", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--seconds", type=float, default=20.0, help="length of a measurement of ages (default: 20)")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended by a signal"))
    found = asyncio.run(measure(arguments.seconds))
    print(json.dumps(found) if arguments.json else "\n".join(f"{name}: {value}" for name, value in found.items()))


async def measure(seconds: float) -> dict[str, Any]:
    """Do everything."""
    async with place(GOOD_MBIT) as here:
        note("a thin link")
        async with here.gateway():
            found = await _ages(here, "thin", seconds)
        note(f"{found}\na thin link with a budget")
        async with here.gateway("--uplink-mbit", str(BUDGET * THIN_MBIT)):
            found |= await _ages(here, "budget", seconds)
        note(f"{found}\na link that comes and goes")
        async with here.gateway():
            found["back_s"] = await _back_s(here, GONE_S)
            found["stalled_back_s"] = await _back_s(here, STALLED_S)
    targets = {**at_most(found, "back_s", 2.0), **at_most(found, "stalled_back_s", 1.0)}
    return {
        "targets": targets,
        **found,
        "thin_mbit": THIN_MBIT,
        "good_mbit": GOOD_MBIT,
        "gone_s": GONE_S,
        "stalled_s": STALLED_S,
        "lease_s": LEASE_S,
        "hz": HZ,
        "image": "640x480 jpeg",
        "seconds": seconds,
        "machine": machine(),
        "versions": versions(["eclipse-zenoh"]),
        "seeds": [SEED],
    }


async def _ages(here: Place, name: str, seconds: float) -> dict[str, Any]:
    """Measure on a thin link that has been one for a while."""
    here.relay.mbit = THIN_MBIT
    await asyncio.sleep(BETWEEN_S)
    since_s = time.time()
    await asyncio.sleep(seconds)
    ages_ms = [age * 1000 for age in here.log(since_s).ages_s()]
    here.relay.mbit = GOOD_MBIT
    return {
        f"{name}_hz": round(len(ages_ms) / seconds, 2),
        f"{name}_age_p50_ms": percentile(ages_ms, 50) if ages_ms else None,
        f"{name}_age_p95_ms": percentile(ages_ms, 95) if ages_ms else None,
    }


async def _back_s(here: Place, gone_s: float) -> float:
    """Return how long class lists took at most to come again."""
    taken = []
    for _ in range(OUTAGES):
        await asyncio.sleep(BETWEEN_S)
        here.relay.set_up(up=False)
        await asyncio.sleep(gone_s)
        here.relay.set_up(up=True)
        up_s = time.time()
        taken.append(await here.first_after(up_s) - up_s)
        note(f"{gone_s:g} s without a link: {taken[-1]:.2f} s")
    return round(max(taken), 3)


if __name__ == "__main__":
    main()
