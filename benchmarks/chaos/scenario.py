"""One fault on a fleet that is well: how long until all of it is well again, and what it cost."""

import asyncio
import time
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from benchmarks.chaos import observer as of
from benchmarks.chaos import resources
from benchmarks.chaos.accounts import Alerts, Window, arrivals, losses, missing
from benchmarks.chaos.faults import Fault
from benchmarks.chaos.frames import Frames, frames
from benchmarks.chaos.observer import Observer
from benchmarks.chaos.system import System
from benchmarks.chaos.worker import PHASE_S
from benchmarks.gateway.processes import PeerError
from benchmarks.monitor.report import percentile
from services.monitor.history.state import HistoryError

RESULTS: Final = (of.LISTS, of.DISTANCES, of.CLOUDS, of.WORLD)
STORE: Final = "store"
MONITOR: Final = "monitor"
LOOK_S: Final = 0.1
TIMEOUT_S: Final = 60.0
DRAIN_S: Final = 8.0
"""Time after the recovery in which lists may still come to the store; more are lost."""

STORED_S: Final = 0.7
"""After such a time the history has what was published: it writes twice a second."""

AHEAD_NS: Final = 1_000_000_000
"""What is so much newer than now is of before the clock was set back."""

NEWEST: Final = 50
"""How many of the newest lists are looked for at the store, to see whether one of them is there."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The fleet in the middle of a phase: pallets came, or went, a second ago.

    published: how many lists so far. told: ids of the alerts that were on the bus so far.
    """

    published: int
    alerts: Mapping[str, bool]
    told: AbstractSet[str]
    uses: Mapping[str, resources.Use]
    frames: Frames


class Scenario:
    """A fleet, and faults that it suffers one after the other."""

    def __init__(self, system: System, observer: Observer) -> None:
        self._system = system
        self._observer = observer
        self._ill: list[str] = []

    async def calm(self) -> None:
        """Wait until the whole fleet is well.

        Raises:
            PeerError: it is not.
        """
        if await self._well(self._system.now_ns(), time.monotonic()) is None:
            raise PeerError(f"the fleet is not well after {TIMEOUT_S:g} s: {self._ill}; {self._system.last_words()}")

    async def suffer(self, fault: Fault) -> dict[str, Any]:
        """Have one fault; return what is printed of it.

        Raises:
            PeerError: the fleet is not well before, or a process ended that should not.
        """
        fault.before(self._system)
        await self.calm()
        before = await self._moment()
        watching = [asyncio.create_task(self._observer.note_problems())]
        if fault.images:
            watching.append(asyncio.create_task(self._observer.watch_images()))
        answer = await self._observer.answer()
        said_before = set(answer.problems) if answer is not None else set()
        self._observer.seen.forget()
        began_s, began_ns = time.monotonic(), self._system.now_ns()
        await fault.hold(self._system)
        ended_s, ended_ns = time.monotonic(), self._system.now_ns()
        ages_s = [age_s for _, age_s in self._observer.seen.ages]
        images, image_bytes = self._observer.seen.images, self._observer.seen.image_bytes
        for task in watching:
            task.cancel()
        said = sorted(self._observer.seen.problems - said_before)
        times = await self._well(ended_ns, ended_s)
        found: dict[str, Any] = {
            "name": fault.name,
            "recovered_s": None if times is None else round(max(times.values()), 2),
            "recovered_by": times,
            "monitor_said": [line[:120] for line in said],
            "held_s": round(ended_s - began_s, 1),
        }
        if times is None:
            found["ill"] = self._ill
        well_ns = self._system.now_ns()
        await asyncio.sleep(fault.lasts_s)
        await self._alerted(before.published)
        found |= await self._cost(before, began_ns, well_ns)
        if fault.images:
            mbit = image_bytes * 8 / 1e6 / (ended_s - began_s)
            found |= {"images": images, "images_mbit": round(mbit, 2), **latencies(ages_s)}
        fault.after(self._system)
        return found

    async def _cost(self, before: Moment, began_ns: int, well_ns: int) -> dict[str, Any]:
        await self._drained(before.published)
        after = await self._moment()
        everything = self._system.journal.lists()
        published = everything[before.published : after.published]
        marks = [each.mark for each in published]
        stored = await self._system.store.rows(marks)
        alerts = Alerts(before.alerts.keys(), after.alerts, after.told - before.told)
        window = Window(began_ns, well_ns, before=everything[before.published - 1].pallet)
        cost = losses(published, stored, alerts, window)
        lost = set(missing(published, stored))
        grown = resources.growth(before.uses, after.uses)
        return {
            **cost.figures(),
            "lost_at_s": [round((each.received_ns - began_ns) / 1e9, 2) for each in published if each.mark in lost][
                :10
            ],
            "frames": (after.frames - before.frames).figures(),
            "rss_growth_mb": max((mb for mb, _ in grown.values()), default=0.0),
            "files_growth": max((files for _, files in grown.values()), default=0),
            "grown": {role: list(more) for role, more in grown.items() if more[0] > 1 or more[1] > 0},
        }

    async def _alerted(self, since: int) -> None:
        """Wait until a pallet came into view, so that there is an alert to lose."""
        until_s = time.monotonic() + 2 * PHASE_S
        while time.monotonic() < until_s:
            if arrivals(self._system.journal.lists()[since:], before=True):
                return
            await asyncio.sleep(LOOK_S)

    async def _drained(self, since: int) -> None:
        """Wait until the store has all that was published, or the time for that is over."""
        until_s = time.monotonic() + DRAIN_S
        while time.monotonic() < until_s:
            published = self._system.journal.lists()[since:]
            with suppress(HistoryError):
                if not missing(published, await self._system.store.rows([each.mark for each in published])):
                    return
            await asyncio.sleep(2 * LOOK_S)

    async def _moment(self) -> Moment:
        """Wait for the middle of a phase; return what there is then."""
        phase_s = time.monotonic() % PHASE_S
        middle_s = PHASE_S / 2 - phase_s
        await asyncio.sleep(middle_s if middle_s >= 0 else middle_s + PHASE_S)
        published = len(self._system.journal.lists())
        await asyncio.sleep(STORED_S)
        alerts, told = await self._system.store.alerts(), frozenset(self._observer.seen.alerts)
        return Moment(published, alerts, told, resources.uses(self._system.pids()), frames(self._observer.seen))

    async def _well(self, since_ns: int, since_s: float) -> dict[str, float] | None:
        """Wait until the fleet has results of frames since a time; return after how many seconds each part has.

        None if that takes longer than TIMEOUT_S.
        """
        times: dict[str, float] = {}
        self._observer.seen.newest_ns.clear()
        published = len(self._system.journal.lists())
        parts = [*RESULTS, STORE, MONITOR]
        while len(times) < len(parts):
            self._system.check()
            for part in parts:
                if part not in times and await self._has(part, since_ns, published):
                    times[part] = round(time.monotonic() - since_s, 2)
            self._ill = [part for part in parts if part not in times]
            if time.monotonic() > since_s + TIMEOUT_S:
                return None
            await asyncio.sleep(LOOK_S)
        return times

    async def _has(self, part: str, since_ns: int, published: int) -> bool:
        until_ns = self._system.now_ns() + AHEAD_NS
        if part == MONITOR:
            return await self._observer.answer() is not None
        if part == STORE:
            lists = self._system.journal.lists()[published:][-NEWEST:]
            new = [each.mark for each in lists if since_ns < each.received_ns < until_ns]
            with suppress(HistoryError):
                return bool(new) and bool(await self._system.store.rows(new))
            return False
        return since_ns < self._observer.seen.newest_ns.get(part, 0) < until_ns


def latencies(ages_s: Sequence[float]) -> dict[str, float | None]:
    """Return the ages of class lists, from the gateway to the centre, in milliseconds."""
    ages_ms = [age_s * 1e3 for age_s in ages_s]
    return {
        "lists_seen": len(ages_ms),
        "age_p50_ms": percentile(ages_ms, 50) if ages_ms else None,
        "age_p99_ms": percentile(ages_ms, 99) if ages_ms else None,
    }
