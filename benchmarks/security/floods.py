"""Floods of messages at a monitor of its own: how much memory it takes meanwhile, and how long its answers take."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, Final

from benchmarks.gateway.flow import free_endpoint
from benchmarks.gateway.processes import PeerError, Process, module, running
from benchmarks.monitor.scenario import TOOLBOX
from bus import Bus, BusSettings, RequestError, open_bus
from schemas import codec, keys
from schemas.inventory import InventoryAnswer, InventoryRequest

START_S: Final = 60.0
ASK_S: Final = 10.0
LOOK_S: Final = 0.1
AFTER_S: Final = 1.0
"""What was on its way when a flood ended is taken in by then."""


@dataclass(frozen=True, slots=True)
class Flood:
    """What a flood did. answer_s: the longest answer of the monitor, during and shortly after it."""

    sent: int
    sent_mb: float
    rss_growth_mb: float
    answer_s: float
    left_out: dict[str, int]
    problems: list[str]

    def figures(self) -> dict[str, Any]:
        """Return what is printed."""
        return {
            "sent": self.sent,
            "sent_mb": self.sent_mb,
            "rss_growth_mb": round(self.rss_growth_mb, 1),
            "answers_s": round(self.answer_s, 2),
            "left_out": sum(self.left_out.values()),
        }


@dataclass(slots=True)
class Victim:
    """A monitor, which is a router too."""

    process: Process
    bus: Bus
    endpoint: str

    async def answer(self) -> InventoryAnswer:
        """Return what it says about one robot.

        Raises:
            RequestError: it does not answer.
        """
        question = codec.encode(InventoryRequest(robot="r1"))
        reply = await self.bus.request(
            keys.INVENTORY, question, encoding=codec.encoding(InventoryRequest), timeout_s=ASK_S
        )
        return codec.decode(InventoryAnswer, reply.payload, reply.encoding)

    async def flood(self, kind: str, seconds: float, least: int = 0) -> Flood:
        """Send a flood of a kind (see `benchmarks.peers.flood`) for so long, and of so many messages at least.

        Raises:
            PeerError: the monitor, or the sender, ended.
        """
        with running(module("flood", kind, self.endpoint, str(seconds), str(least))) as sender:
            before = highest = self.process.rss_bytes()
            sending = asyncio.create_task(asyncio.to_thread(sender.answer, START_S + seconds))
            longest_s, ended_s = 0.0, float("inf")
            asking = asyncio.create_task(self._time())
            while time.monotonic() < ended_s + AFTER_S:
                await asyncio.sleep(LOOK_S)
                highest = max(highest, self.process.rss_bytes())
                if asking.done():
                    longest_s = max(longest_s, asking.result())
                    asking = asyncio.create_task(self._time())
                if sending.done():
                    ended_s = min(ended_s, time.monotonic())
            longest_s = max(longest_s, await asking)
            sent = await sending
        said = await self.answer()
        growth = (highest - before) / 2**20
        return Flood(sent["sent"], sent["sent_mb"], growth, longest_s, said.left_out, said.problems)

    async def _time(self) -> float:
        """Return how long an answer takes."""
        if not self.process.runs():
            raise PeerError(self.process.last_words())
        began_s = time.monotonic()
        try:
            await self.answer()
        except RequestError:
            return max(ASK_S, time.monotonic() - began_s)
        return time.monotonic() - began_s


@asynccontextmanager
async def victim(*options: str) -> AsyncIterator[Victim]:
    """Start a monitor."""
    endpoint = free_endpoint()
    command = [*TOOLBOX, "monitor", "--listen", endpoint, "--no-web", "--history", "none", *options]
    with running(command) as process:
        async with open_bus(BusSettings(connect=[endpoint], shared_memory=False)) as bus:
            made = Victim(process, bus, endpoint)
            until_s = time.monotonic() + START_S
            while True:
                try:
                    await made.answer()
                except RequestError as error:
                    if time.monotonic() > until_s or not process.runs():
                        raise PeerError(process.last_words()) from error
                    await asyncio.sleep(LOOK_S)
                else:
                    break
            yield made
