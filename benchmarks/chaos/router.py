"""A Zenoh router, opened as the monitor opens its own. Argument: its `BusSettings` in JSON. Ends with its input."""

import asyncio
import sys

from benchmarks.peers.answering import answer
from bus import BusSettings, open_bus


async def run(settings: BusSettings) -> None:
    """Route until the standard input ends."""
    async with open_bus(settings):
        await asyncio.to_thread(answer, dict)


if __name__ == "__main__":
    asyncio.run(run(BusSettings.model_validate_json(sys.argv[1])))
