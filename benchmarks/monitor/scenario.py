"""The robots of a measurement, the monitor, and the router of them all, which is the monitor or a process apart."""

import asyncio
import itertools
import subprocess
import sys
import time
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass
from math import inf
from pathlib import Path
from secrets import token_hex
from typing import Any, Final

import httpx

from benchmarks.gateway.flow import free_endpoint
from benchmarks.gateway.processes import PeerError, Process, module, running
from benchmarks.monitor.report import Flow
from bus import Bus, BusSettings, Publisher, QoS, RequestError, open_bus
from schemas import codec, keys
from schemas.detections import ClassCount, ClassList
from schemas.header import Header
from schemas.inventory import InventoryAnswer, InventoryRequest
from schemas.keys import CameraKey, Stream
from services.toolbox.demo.children import free_ports

PUBLISHERS: Final = 4
"""Processes that the robots are shared by."""

IN_A_ROW: Final = 25
"""Robots of one session, if there are as many: a detector that works off a batch publishes so many lists at a time."""

SETTLED_S: Final = 2.0
"""By then a list has arrived, or is lost."""

TIMEOUT_S: Final = 30.0
"""For what takes a moment on a machine that does nothing else."""

ARRIVING: Final = 1_000
"""How many robots come until it is looked whether they are heard."""

ASK_S: Final = 3.0
PROBE_S: Final = 0.05
VISIT_S: Final = 0.2
PATHS: Final = ("/", "/api/v1/robots", "/api/v1/inventory?in_view=true")
TOOLBOX: Final = (sys.executable, "-m", "services.toolbox")
PROBE: Final = CameraKey("probe", "front")

RULES: Final = """
rules:
  - {name: crowded, when: over, class: box, count: 50}
  - {name: forklift too near, when: nearer, class: forklift, than_m: 2, severity: critical}
  - {name: camera silent, when: silent, cameras: ["*"], for_s: 600}
"""


@dataclass
class Probe:
    """A robot's camera whose lists are looked for in the inventory."""

    publisher: Publisher
    seq: int = 0

    def put(self) -> float:
        """Publish a list; return the score that tells it from all others."""
        self.seq += 1
        now_ns, score = time.time_ns(), self.seq / 1_000_000
        header = Header(
            robot=PROBE.robot,
            camera=PROBE.camera,
            boot_id="probe",
            seq=self.seq,
            stamp_ns=now_ns,
            frame_id="",
            received_ns=now_ns,
        )
        seen = ClassList(header=header, classes=[ClassCount("box", 1, score)], model="m", worker="w")
        self.publisher.put(codec.encode(seen))
        return score


class Scenario:
    """Robots and one monitor."""

    def __init__(
        self, bus: Bus, monitor: Process, publishers: list[Process], probe: Probe, web: httpx.AsyncClient
    ) -> None:
        self.monitor = monitor
        self._web = web
        self._bus = bus
        self._publishers = publishers
        self._probe = probe

    async def robots(self, number: int) -> None:
        """Have so many robots, in steps; return when the monitor takes all that all of them send."""
        for known in [*range(ARRIVING, number, ARRIVING), number]:
            for publisher in self._publishers:
                publisher.tell(f"robots {known // len(self._publishers)}")
            await self._answers(2 * TIMEOUT_S)
            await asyncio.sleep(SETTLED_S)
            until_s = time.monotonic() + 2 * TIMEOUT_S
            while (flow := await self.send(1.0, 2.0)).lost:
                if time.monotonic() > until_s:
                    raise PeerError(f"of {known} robots' lists {flow.lost} are lost: {self.monitor.last_words()}")

    async def send(self, hz: float, seconds: float, *, watched: bool = False) -> Flow:
        """Have every robot send at a rate for so long; return what became of it.

        watched: people look at pages and programs ask meanwhile; else there are no times of theirs.
        """
        before, cpu_s = await self.taken() - self._probe.seq, self.monitor.cpu_s()
        for publisher in self._publishers:
            publisher.tell(f"send {hz} {seconds}")
        latencies, pages, ended = list[float](), dict[str, list[float]](), asyncio.Event()
        began_s = time.monotonic()
        async with asyncio.TaskGroup() as group:
            if watched:
                group.create_task(self._look(latencies, ended))
                group.create_task(self._visit(pages, ended))
            answers = await self._answers(seconds + TIMEOUT_S)
            took_s = time.monotonic() - began_s
            cpu_share = (self.monitor.cpu_s() - cpu_s) / took_s
            ended.set()
        await asyncio.sleep(SETTLED_S)
        sent = sum(answer["sent"] for answer in answers)
        return Flow(
            lost=sent - (await self.taken() - self._probe.seq - before),
            sent_per_s=(sent + len(latencies)) / took_s,
            latencies_ms=latencies,
            pages_ms=pages,
            cpu_share=cpu_share,
            late_ms=max(answer["late_ms"] for answer in answers),
        )

    async def _answers(self, within_s: float) -> list[dict[str, Any]]:
        """Return what the publishers say when they are done."""
        return await asyncio.gather(*(asyncio.to_thread(each.answer, within_s) for each in self._publishers))

    async def taken(self) -> int:
        """Return how many class lists the monitor took in."""
        return (await self._inventory("nobody")).class_lists

    async def _look(self, latencies: list[float], ended: asyncio.Event) -> None:
        """Publish lists one by one; note after how many milliseconds an answer of the inventory shows each."""
        self._probe.put()  # what one list says alone is no sighting yet
        while not ended.is_set():
            put_s = time.monotonic()
            until_s, score = put_s + ASK_S, self._probe.put()
            while not await self._shows(score):
                if time.monotonic() > until_s:  # a loss is noticed when the next one comes
                    until_s, score = time.monotonic() + ASK_S, self._probe.put()
            latencies.append((time.monotonic() - put_s) * 1e3)
            await asyncio.sleep(PROBE_S)

    async def _visit(self, pages: dict[str, list[float]], ended: asyncio.Event) -> None:
        """Fetch page and API in turn; note after how many milliseconds the whole answer is there, inf for an error."""
        for path in itertools.cycle(PATHS):
            if ended.is_set():
                return
            began_s = time.monotonic()
            try:
                answers = (await self._web.get(path)).is_success
            except httpx.HTTPError:
                answers = False
            took_ms = (time.monotonic() - began_s) * 1e3
            pages.setdefault(path, []).append(took_ms if answers else inf)
            await asyncio.sleep(VISIT_S)

    async def _shows(self, score: float) -> bool:
        answer = await self._inventory(PROBE.robot)
        return any(sighting.score == score for sighting in answer.sightings)

    async def _inventory(self, robot: str) -> InventoryAnswer:
        request = codec.encode(InventoryRequest(robot=robot, in_view=False))
        encoding = codec.encoding(InventoryRequest)
        until_s = time.monotonic() + TIMEOUT_S
        while True:  # the bus drops requests rather than wait for a link
            try:
                reply = await self._bus.request(keys.INVENTORY, request, encoding=encoding, timeout_s=ASK_S)
            except RequestError as error:
                if time.monotonic() > until_s or not self.monitor.runs():
                    raise PeerError(f"the monitor does not answer ({error}); {self.monitor.last_words()}") from error
                await asyncio.sleep(PROBE_S)
            else:
                return codec.decode(InventoryAnswer, reply.payload, reply.encoding)


@asynccontextmanager
async def scenario(folder: Path, robots: int, sessions: int, *, apart: bool) -> AsyncIterator[Scenario]:
    """Start everything; the robots, which share sessions, are still to come.

    apart: the router is another process, the monitor its client.
    """
    rules = folder / "rules.yaml"
    rules.write_text(RULES, encoding="utf-8")
    router = free_endpoint()
    history, port = f"sqlite:///{folder}/history.db", free_ports(1)
    token = await asyncio.to_thread(token_of_a_viewer, history)
    where = ["--mode", "client", "--connect", router] if apart else ["--listen", router]
    command = ["monitor", *where, "--web-port", str(port)]
    web = httpx.AsyncClient(
        base_url=f"http://127.0.0.1:{port}", headers={"Authorization": f"Bearer {token}"}, timeout=TIMEOUT_S
    )
    with ExitStack() as stack:
        if apart:
            stack.enter_context(running(module("router", router)))
        monitor = stack.enter_context(running([*TOOLBOX, *command, "--history", history, "--rules", str(rules)]))
        share, of_each = robots // PUBLISHERS, sessions // PUBLISHERS
        in_a_row = max(1, min(IN_A_ROW, robots // sessions))
        publishers = [
            stack.enter_context(running(module("class_lists", *map(str, (router, index * share, of_each, in_a_row)))))
            for index in range(PUBLISHERS)
        ]
        async with (
            web,
            open_bus(BusSettings(connect=[router], shared_memory=False)) as bus,
            bus.announce(keys.robot_alive(PROBE.robot)),
            bus.announce(PROBE.alive(Stream.COLOR)),
            bus.publisher(PROBE.stream(Stream.CLASSES), QoS.RESULT, encoding=codec.encoding(ClassList)) as publisher,
        ):
            made = Scenario(bus, monitor, publishers, Probe(publisher), web)
            await made.taken()
            yield made


def token_of_a_viewer(history: str) -> str:
    """Make somebody who may look; return what they are known by."""
    users = [*TOOLBOX, "users"]
    subprocess.run(
        [*users, "add", "viewer", "--history", history],
        input=f"{token_hex()}\n" * 2,
        text=True,
        check=True,
        stdout=subprocess.DEVNULL,
    )
    made = subprocess.run([*users, "token", "viewer", "--history", history], capture_output=True, text=True, check=True)
    return made.stdout.split()[-1]
