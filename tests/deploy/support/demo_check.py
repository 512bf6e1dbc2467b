"""The demo's check for a fleet that runs: `python demo_check.py ENDPOINT ROBOT...`, where the monitor is installed.

Prints the demo's summary; ends with 1 where it is not complete in time. It runs in images, which have no tests.
"""

import asyncio
import sys
import time
from pathlib import Path
from tempfile import mkdtemp

from bus import open_bus
from bus.clocks import clock_id
from services.monitor.fleet import Fleet
from services.monitor.process import running
from services.monitor.settings import MonitorSettings
from services.toolbox.demo.summary import Summary

DEADLINE_S = 90


async def main(endpoint: str, *robots: str) -> int:
    began_s, folder = time.monotonic(), Path(mkdtemp())
    settings = MonitorSettings(
        mode="client", connect=[endpoint], listen=[], history=f"sqlite:///{folder / 'history.db'}"
    )
    fleet = Fleet(clock_id())
    async with open_bus(settings) as bus, running(settings, bus, fleet):
        while True:
            summary = Summary.of(fleet, robots, {}, began_s)
            if summary.complete or time.monotonic() > began_s + DEADLINE_S:
                break
            await asyncio.sleep(0.2)
    sys.stdout.write("\n".join([*summary.lines(), ""]))
    return 0 if summary.complete else 1


if __name__ == "__main__":
    sys.exit(asyncio.run(main(*sys.argv[1:])))
