"""Floods of messages at a monitor of its own: how much memory it takes meanwhile, and how long its answers take."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Final

import httpx

from benchmarks.gateway.flow import free_endpoint
from benchmarks.gateway.processes import PeerError, Process, module, running
from benchmarks.monitor.scenario import TOOLBOX
from benchmarks.peers.link_flood import FLOODS as LINK_FLOODS
from bus import Bus, BusSettings, NotServedError, Publisher, QoS, RequestError, open_bus
from schemas import codec, keys
from schemas.detections import ClassCount, ClassList
from schemas.header import Header
from schemas.inventory import InventoryAnswer, InventoryRequest
from schemas.keys import CameraKey, Stream

START_S: Final = 60.0
ASK_S: Final = 10.0
LOOK_S: Final = 0.1
LOST_S: Final = 20.0
"""A class list that is not seen after this counts as lost."""

AFTER_S: Final = 1.0
"""What was on its way when a flood ended is taken in by then."""


@dataclass(frozen=True, slots=True)
class Flood:
    """What a flood did.

    answer_s: the longest answer of the monitor, during and shortly after it. others_s: the longest time until it had
    taken in a class list of a robot that has no part in it.
    """

    sent: int
    sent_mb: float
    rss_growth_mb: float
    answer_s: float
    others_s: float
    left_out: dict[str, int]
    problems: list[str]

    def figures(self) -> dict[str, Any]:
        """Return what is printed."""
        return {
            "sent": self.sent,
            "sent_mb": self.sent_mb,
            "rss_growth_mb": round(self.rss_growth_mb, 1),
            "answers_s": round(self.answer_s, 2),
            "others_s": round(self.others_s, 2),
            "left_out": sum(self.left_out.values()),
        }


@dataclass(slots=True)
class Victim:
    """A monitor, which is a router too. page: host and port of its page, if it has one."""

    process: Process
    bus: Bus
    endpoint: str
    page: str = ""

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
        async with _other_robot(self) as other:
            return await self._flood(other, kind, seconds, least)

    async def _flood(self, other: "OtherRobot", kind: str, seconds: float, least: int) -> Flood:
        command = module("flood", kind, self.endpoint, str(seconds), str(least))
        if kind in LINK_FLOODS:
            command = module("link_flood", kind, self.page or self.endpoint, str(seconds))
        with running(command) as sender:
            before = highest = self.process.rss_bytes()
            sending = asyncio.create_task(asyncio.to_thread(sender.answer, START_S + seconds))
            longest_s, others_s, ended_s = 0.0, 0.0, float("inf")
            asking, speaking = asyncio.create_task(self._time()), asyncio.create_task(other.time())
            while time.monotonic() < ended_s + AFTER_S:
                await asyncio.sleep(LOOK_S)
                highest = max(highest, self.process.rss_bytes())
                if asking.done():
                    longest_s = max(longest_s, asking.result())
                    asking = asyncio.create_task(self._time())
                if speaking.done():
                    others_s = max(others_s, speaking.result())
                    speaking = asyncio.create_task(other.time())
                if sending.done():
                    ended_s = min(ended_s, time.monotonic())
            longest_s, others_s = max(longest_s, await asking), max(others_s, await speaking)
            sent = await sending
        said = await self.answer()
        growth = (highest - before) / 2**20
        return Flood(sent["sent"], sent["sent_mb"], growth, longest_s, others_s, said.left_out, said.problems)

    async def _time(self) -> float:
        """Return how long an answer takes, and, with a page, one of it."""
        if not self.process.runs():
            raise PeerError(self.process.last_words())
        began_s = time.monotonic()
        try:
            await self.answer()
        except RequestError:
            return max(ASK_S, time.monotonic() - began_s)
        if self.page and not await asyncio.to_thread(self._page_answers):
            return max(ASK_S, time.monotonic() - began_s)
        return time.monotonic() - began_s

    def _page_answers(self) -> bool:
        """Ask for the page's log-in form as a browser does that is not logged in; return whether it came."""
        with suppress(OSError):
            answer: int = httpx.get(f"http://{self.page}/login", timeout=ASK_S).status_code
            return answer in (HTTPStatus.OK, HTTPStatus.SEE_OTHER)
        return False


OTHER: Final = CameraKey("r1", "front")


class OtherRobot:
    """A robot that goes on sending class lists while somebody else floods the monitor."""

    def __init__(self, monitor: Victim, lists: Publisher) -> None:
        self._monitor = monitor
        self._lists = lists
        self._seq = 0

    async def begin(self) -> None:
        """Send lists until the monitor shows what is in them: it takes more than one to believe in."""
        async with asyncio.timeout(START_S):
            while not await self._is_shown(self._send()):  # noqa: ASYNC110 - nothing tells of it
                await asyncio.sleep(LOOK_S)

    async def time(self) -> float:
        """Send a list; return how long the monitor takes to show what is in it."""
        began_s = time.monotonic()
        score = self._send()
        while (took_s := time.monotonic() - began_s) < LOST_S:
            if await self._is_shown(score):
                break
            await asyncio.sleep(LOOK_S)
        return took_s

    async def _is_shown(self, score: float) -> bool:
        with suppress(RequestError):
            return any(each.score == score for each in (await self._monitor.answer()).sightings)
        return False

    def _send(self) -> float:
        """Send a list; return the score in it, which no other has."""
        self._seq += 1
        score = self._seq / 2**20
        now_ns = time.time_ns()
        header = Header(
            robot=OTHER.robot,
            camera=OTHER.camera,
            boot_id="other",
            seq=self._seq,
            stamp_ns=now_ns,
            frame_id="",
            received_ns=now_ns,
        )
        seen = ClassList(header=header, classes=[ClassCount("pallet", 1, score)], model="m", worker="w")
        self._lists.put(codec.encode(seen))
        return score


@asynccontextmanager
async def _other_robot(monitor: Victim) -> AsyncIterator[OtherRobot]:
    """Have a robot there of which the monitor has heard."""
    bus = monitor.bus
    lists = bus.publisher(OTHER.stream(Stream.CLASSES), QoS.RESULT, encoding=codec.encoding(ClassList))
    async with bus.announce(keys.robot_alive(OTHER.robot)), bus.announce(OTHER.alive(Stream.COLOR)), lists as publisher:
        other = OtherRobot(monitor, publisher)
        await other.begin()
        yield other


@asynccontextmanager
async def victim(*options: str, page: bool = False) -> AsyncIterator[Victim]:
    """Start a monitor, with a page or without."""
    endpoint = free_endpoint()
    at = free_endpoint().removeprefix("tcp/") if page else ""
    web = ["--web-port", at.rpartition(":")[2]] if page else ["--no-web"]
    command = [*TOOLBOX, "monitor", "--listen", endpoint, *web, "--history", "none", *options]
    with running(command) as process:
        async with open_bus(BusSettings(connect=[endpoint], shared_memory=False)) as bus:
            made = Victim(process, bus, endpoint, at)
            until_s = time.monotonic() + START_S
            while True:
                try:
                    await made.answer()
                    if at and not await asyncio.to_thread(made._page_answers):  # noqa: SLF001 - its own
                        raise NotServedError(at)
                except RequestError as error:
                    if time.monotonic() > until_s or not process.runs():
                        raise PeerError(process.last_words()) from error
                    await asyncio.sleep(LOOK_S)
                else:
                    break
            yield made
