"""A router, the robots' processes, and a client that watches all of them."""

import asyncio
import itertools
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager
from typing import Any, Final, Literal

from benchmarks.gateway.flow import free_endpoint
from benchmarks.gateway.link_meter import LinkMeter
from benchmarks.gateway.processes import PeerError, Process, module, running
from benchmarks.peers.gateways import STREAMS
from benchmarks.progress import note
from bus import QUEUE, Bus, BusSettings, Watch, open_bus
from schemas import keys

Kind = Literal["alone", "beside"]
"""Whether services beside a robot could connect to its gateway."""

PROCESSES: Final = 5
DOWN_S: Final = 3.0
"""By then everybody knows that the router is gone."""

QUIET_S: Final = 2.0
"""By then all that a joining robot sends and is sent has crossed its link."""

TIMEOUT_S: Final = 240.0
RESTART_LIMIT_S: Final = 60.0
STEP_S: Final = 0.1
TOKENS: Final = len(STREAMS) + 1
"""Tokens of a robot, in one list: its own, and one of each stream."""


class Fleet:
    """Robots at one router, seen by a client."""

    def __init__(self, endpoint: str, kind: Kind, stack: AsyncExitStack, bus: Bus, peers: list[Process]) -> None:
        self._endpoint = endpoint
        self._kind = kind
        self._stack = stack
        self._peers = peers
        self._bus = bus
        self._robots = 0
        self._present: set[str] = set()
        self._routers = ExitStack()
        self._joined = itertools.count()
        stack.push(self._routers)
        self._router = self._start()
        self._empty_kb = 0.0

    def _start(self) -> Process:
        router = self._routers.enter_context(running(module("router", self._endpoint)))
        router.tell("")
        return router

    async def watch(self, watch: Watch) -> None:
        """Note who is present, forever."""
        async for token in watch:
            (self._present.add if token.alive else self._present.discard)(token.key)

    async def ready(self) -> None:
        """Wait for the router and the client's link to it."""
        await asyncio.to_thread(self._router.answer, TIMEOUT_S)
        await self._until(lambda: not self._bus.link_problem)
        self._empty_kb = self._router.rss_bytes() / 1e3

    async def grow(self, number: int) -> dict[str, Any]:
        """Have so many robots; return how long they took to come, and what the router took for it."""
        began_s, cpu_s, more = time.monotonic(), self._router.cpu_s(), number - self._robots
        shares = [
            number * (each + 1) // len(self._peers) - number * each // len(self._peers)
            for each in range(len(self._peers))
        ]
        answers = await asyncio.gather(
            *(asyncio.to_thread(_ask, peer, f"robots {share}") for peer, share in zip(self._peers, shares, strict=True))
        )
        self._robots = sum(int(answer["robots"]) for answer in answers)
        await self._until(self._all_are_present)
        kb = self._router.rss_bytes() / 1e3
        found = {
            "coming_s": round(time.monotonic() - began_s, 1),
            "router_cpu_ms_per_robot_coming": round((self._router.cpu_s() - cpu_s) / max(1, more) * 1e3, 2),
            "router_mb": round(kb / 1e3, 1),
            "router_kb_per_robot": round((kb - self._empty_kb) / number, 1),
        }
        note(f"{self._robots} robots: {found}")
        return found

    async def join(self) -> int:
        """Have one more robot join and go again; return the bytes that crossed its link both ways."""
        with LinkMeter(int(self._endpoint.rpartition(":")[2])) as meter, ExitStack() as stack:
            first = 1_000_000 + next(self._joined)
            peer = stack.enter_context(running(module("gateways", meter.endpoint, str(first), self._kind)))
            await asyncio.to_thread(_ask, peer, "robots 1")
            await self._until(lambda: keys.robot_alive(f"r{first}") in self._present)
            await asyncio.sleep(QUIET_S)
            crossed = meter.payload_bytes
        await self._until(lambda: keys.robot_alive(f"r{first}") not in self._present)
        return crossed

    async def restart(self) -> dict[str, Any]:
        """Kill the router and start another one; return how long everybody takes to be back, None if longer than this.

        restart_missing: robots and streams that were not back within RESTART_LIMIT_S.
        """
        self._router.kill()
        await self._until(lambda: not self._present)
        await asyncio.sleep(DOWN_S)
        began_s = time.monotonic()
        self._router = self._start()
        while not self._all_are_present() and time.monotonic() < began_s + RESTART_LIMIT_S:  # noqa: ASYNC110
            await asyncio.sleep(STEP_S)
        back = self._all_are_present()
        found = {
            "restart_s": round(time.monotonic() - began_s, 1) if back else None,
            "restart_missing": max(0, self._robots * TOKENS - len(self._present)),
            "restart_router_cpu_s": round(self._router.cpu_s(), 1),
        }
        note(f"restart of {self._robots}: {found}")
        return found

    def _all_are_present(self) -> bool:
        return len(self._present) >= self._robots * TOKENS

    async def _check(self, began_s: float) -> None:
        if time.monotonic() > began_s + TIMEOUT_S:
            raise PeerError(f"{len(self._present)} of {self._robots * TOKENS} tokens: {self._router.last_words()}")
        await asyncio.sleep(STEP_S)

    async def _until(self, done: Callable[[], bool]) -> None:
        began_s = time.monotonic()
        while not done():
            await self._check(began_s)


def _ask(peer: Process, what: str) -> dict[str, Any]:
    peer.tell(what)
    return peer.answer(TIMEOUT_S)


@asynccontextmanager
async def fleet(kind: Kind) -> AsyncIterator[Fleet]:
    """Set everything up, without robots."""
    endpoint = free_endpoint()
    first = [number * 100_000 for number in range(PROCESSES)]
    async with AsyncExitStack() as stack:
        peers = [stack.enter_context(running(module("gateways", endpoint, str(number), kind))) for number in first]
        bus = await stack.enter_async_context(open_bus(BusSettings(connect=[endpoint], shared_memory=False)))
        await stack.enter_async_context(bus.subscribe(keys.EVERY_GATEWAY_STATUS, QUEUE(1_000)))
        made = Fleet(endpoint, kind, stack, bus, peers)
        watch = await stack.enter_async_context(bus.watch("fleet/**"))
        watching = asyncio.create_task(made.watch(watch))
        stack.callback(watching.cancel)
        await made.ready()
        yield made
