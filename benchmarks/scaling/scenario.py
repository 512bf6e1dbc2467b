"""The fleet of a measurement, what is done to it, and what its subscriber then saw."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, Final

from benchmarks.gateway.flow import free_endpoint
from benchmarks.gateway.processes import START_S, PeerError, Process, module, running
from benchmarks.progress import note
from benchmarks.scaling.observer import Observer, observing
from benchmarks.scaling.results import Change, Log
from bus import BusSettings

ROBOTS: Final = 8
CAMERAS: Final = 8
HZ: Final = 10.0
FRAME_MS: Final = 50.0
WORKERS: Final = 8
LEASE_S: Final = BusSettings().lease_s

CALM_S: Final = 12.0
"""After such a time every worker knows its pace."""

BEFORE_S: Final = 5.0
"""What counts as before something is done."""

EVENT_S: Final = 5.0
"""What counts as after it."""

ROLL_S: Final = 1.5
"""The pause after each step of a rolling restart."""


class Scenario:
    """64 cameras behind a router, a subscriber to their class lists, and any number of workers."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self._router = free_endpoint()
        stack.enter_context(running(module("router", self._router))).ask()
        self._observer: Observer = stack.enter_context(observing(self._router))
        fleet = (self._router, str(ROBOTS), str(CAMERAS), str(HZ))
        self._cameras = stack.enter_context(running(module("fleet_cameras", *fleet)))
        self._cameras.ask()
        self._workers: dict[str, Process] = {}

    def start(self, *names: str) -> None:
        """Start workers; return when there are results of each."""
        began_s = time.time()
        for name in names:
            command = module("stand_in_worker", self._router, name, str(FRAME_MS))
            self._workers[name] = self._stack.enter_context(running(command))
        self._await(lambda log: set(names) <= set(log.owners().values()), began_s)

    def _await(self, condition: Callable[[Log], bool], since_s: float) -> None:
        deadline = time.monotonic() + START_S
        while not condition(self._log(since_s)):
            if time.monotonic() > deadline:
                words = [worker.last_words() for worker in self._workers.values()]
                raise PeerError("\n".join([*words, f"a worker had no results {START_S:g} s after its start"]))
            time.sleep(0.1)

    def _log(self, from_s: float, to_s: float = float("inf")) -> Log:
        return self._observer.log().between(from_s, to_s)

    def settle(self) -> None:
        """Let the workers find their pace."""
        time.sleep(CALM_S)

    def calm(self, seconds: float) -> dict[str, Any]:
        """Let the workers find their pace, then measure for so long."""
        self.settle()
        sent, began_s = self._cameras.ask()["sent"], time.time()
        time.sleep(seconds)
        sent, ended_s = self._cameras.ask()["sent"] - sent, time.time()
        log = self._log(began_s, ended_s)
        owned = log.workers()
        loads = [list(log.owners().values()).count(name) for name in self._workers]
        ages = sorted(log.ages_s())
        return {
            "results_per_s": round(log.frames() / (ended_s - began_s), 2),
            "useful_fraction": round(log.frames() / max(1, sent), 3),
            "max_age_ms": round(ages[-1] * 1000, 1),
            "p99_age_ms": round(ages[round(0.99 * (len(ages) - 1))] * 1000, 1),
            "double_owned": sum(len(workers) > 1 for workers in owned.values()),
            "unowned": ROBOTS * CAMERAS - len(owned),
            "max_share": round(max(loads) * len(self._workers) / (ROBOTS * CAMERAS), 3),
            "longest_interval_s": round(log.longest_interval_s(), 3),
        }

    def join(self, name: str) -> dict[str, Any]:
        """Have a worker join."""
        began_s = time.time()
        before = self._log(began_s - BEFORE_S, began_s)
        self.start(name)
        time.sleep(EVENT_S)
        changes = self._log(began_s).changes(before)
        return {
            "join_gap_s": round(max(change.gap_s for change in changes), 3),
            "join_interval_s": round(max(change.interval_s for change in changes), 3),
            "join_usual_interval_s": round(max(change.usual_s for change in changes), 3),
            "join_double_s": round(max(change.double_s for change in changes), 3),
            "join_moved": len(changes),
            "join_moved_others": sum(change.new != name for change in changes),
        }

    def crash(self, name: str) -> dict[str, Any]:
        """Kill a worker."""
        before = self._log(time.time() - BEFORE_S)
        began_s = time.time()
        self._workers.pop(name).kill()
        time.sleep(EVENT_S)
        log = self._log(began_s)
        others = [change for change in log.changes(before) if change.old != name]
        return {"failover_s": self._failover_s(log, before, name, began_s), "moved_others": len(others)}

    def _failover_s(self, log: Log, before: Log, name: str, began_s: float) -> float | None:
        """Return how long it took until all cameras of a worker had results from others; None if one has none."""
        orphans = [camera for camera, owner in before.owners().items() if owner == name]
        firsts = [log.first_after(began_s, camera, name) for camera in orphans]
        known = [first for first in firsts if first is not None]
        return round(max(known) - began_s, 3) if len(known) == len(firsts) else None

    def hang(self, name: str) -> dict[str, Any]:
        """Let a worker stand still for longer than its link lives, and then go on."""
        before = self._log(time.time() - BEFORE_S)
        stopped_s = time.time()
        self._workers[name].stop()
        time.sleep(LEASE_S + EVENT_S)
        woken_s = time.time()
        hung = self._log(stopped_s, woken_s)
        self._workers[name].go_on()
        time.sleep(EVENT_S)
        changes = self._log(woken_s).changes(hung)
        return {
            "hang_failover_s": self._failover_s(hung, before, name, stopped_s),
            "woken_double_s": round(max((change.double_s for change in changes), default=0.0), 3),
            "woken_took_back": len(changes),
            "lease_s": LEASE_S,
        }

    def roll(self) -> dict[str, Any]:
        """Restart all workers, one after the other."""
        changes: list[Change] = []
        ends = []
        began_s = time.time()
        for name in list(self._workers):
            note(f"restarting {name}")
            with self._noting(changes):
                ends.append(self._workers[name].end())
            with self._noting(changes):
                self.start(name)
        return {
            "rolling_gap_s": round(max(change.gap_s for change in changes), 3),
            "rolling_interval_s": round(max(change.interval_s for change in changes), 3),
            "rolling_longest_interval_s": round(self._log(began_s).longest_interval_s(), 3),
            "exit_s": round(max(ends), 3),
        }

    @contextmanager
    def _noting(self, changes: list[Change]) -> Iterator[None]:
        """Note which cameras go to other workers on account of what is done meanwhile."""
        began_s = time.time()
        before = self._log(began_s - BEFORE_S)
        yield
        time.sleep(ROLL_S)
        changes += self._log(began_s).changes(before)


@contextmanager
def scenario() -> Iterator[Scenario]:
    """Set the fleet up, without workers."""
    with ExitStack() as stack:
        yield Scenario(stack)
