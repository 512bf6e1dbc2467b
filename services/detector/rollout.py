"""Follows the model registry: fetches what is in force, loads it beside the old model, and puts it in its place."""

import asyncio
import logging
import math
import time
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import suppress
from pathlib import Path
from typing import Final, Literal

import msgspec

from bus import LATEST, Bus, RequestError
from bus.reporting import VERSION, report
from schemas import codec
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL
from schemas.models import ModelRegistry, PublishedModel
from schemas.status import WorkerStatus
from schemas.worker_keys import ModelKey, worker_status
from services.detector.fetching import fetch_rest
from services.detector.fleet_model import FleetModel, LoadedModel
from services.detector.model import Model, ModelError, first_line
from services.detector.model_cache import DamagedModelError, ModelCache
from services.detector.refusals import Refusals, growing_wait_s

log = logging.getLogger(__name__)

RETRY_S: Final = 5.0
MOST_RETRY_S: Final = 600.0
"""Seconds until a model that could not be fetched is asked for again: the first time, and at most."""

LEAST_WAIT_S: Final = 0.5

STEP: Final = 25
"""Percent of a file between two lines of the log."""

NOTHING_YET: Final = "waiting for a model: no monitor with --models is heard, and none was run here before"
NONE_IN_FORCE: Final = "no model is in force: `fleetsight model use NAME` puts one in force"
NOT_IN_CACHE: Final = "is not in --cache: waiting for a monitor with --models"

Slot = Literal["in_force", "canary"]

LoadModel = Callable[[Path], Model]
"""Loads weights; takes seconds, and raises ModelError."""


class _RetryError(Exception):
    """A model cannot be fetched now."""


class _SupersededError(Exception):
    """The registry says something else by now."""


class Rollout:
    """Keeps a FleetModel as the registry says.

    load, executor: how weights are loaded, and the thread for it. model: None until the first one is ready. A model
    that cannot be loaded, or fails later, is refused for a time: another one goes on, and `notes` say why.
    """

    def __init__(self, bus: Bus, cache: ModelCache, load: LoadModel, executor: Executor) -> None:
        self._bus = bus
        self._cache = cache
        self._load = load
        self._executor = executor
        self.model: FleetModel | None = None
        self._last: ModelRegistry | None = None
        self._wanted: ModelRegistry | None = None
        self._heard = asyncio.Event()
        self._ready = asyncio.Event()
        self._refusals = Refusals(cache.folder)
        self._spare: dict[str, LoadedModel] = {}
        self._fetches_failed = 0
        self._notes: dict[Slot, str] = {}
        self._logged = ""
        self._note("in_force", NOTHING_YET)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the roll-out for users: what is waited for, fetched or refused."""
        return tuple(self._notes.values())

    async def run(self) -> None:
        """Follow the registry until cancelled; begin with what was run here last."""
        await asyncio.to_thread(self._refusals.recall)
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._listen())
                self._last = await asyncio.to_thread(self._cache.recall)
                while True:
                    self._heard.clear()
                    state = self._wanted or self._last
                    wait_s = math.inf if state is None else await self._apply(state)
                    with suppress(TimeoutError):
                        async with asyncio.timeout(None if wait_s == math.inf else max(LEAST_WAIT_S, wait_s)):
                            await self._heard.wait()
        finally:
            self._close_spare()
            self._refusals.close()
            self._cache.close()

    async def first(self, service: str, worker: str) -> FleetModel:
        """Return the model once there is one; meanwhile the worker's status says what it waits for."""

        def status() -> WorkerStatus:
            remarks = [note[:MAX_LABEL] for note in self.notes]
            return WorkerStatus(
                service=service, worker=worker, model="", sent_ns=time.time_ns(), remarks=remarks, version=VERSION
            )

        async with asyncio.TaskGroup() as group:
            telling = group.create_task(report(self._bus, worker_status(service, worker), WorkerStatus, status))
            while self.model is None:
                await self._ready.wait()
            telling.cancel()
        return self.model

    def leave_marked(self) -> None:
        """The model in force is what ends this worker: if it never worked, the next start does not begin with it."""
        if self.model is not None:
            self._refusals.leave_marked(self.model.in_force.digest)

    async def _listen(self) -> None:
        async with self._bus.subscribe(ModelKey.REGISTRY, LATEST, few=True) as states:
            async for sample in states:
                try:
                    state = codec.decode(ModelRegistry, sample.payload, sample.encoding)
                except SchemaError as error:
                    log.warning("%s: left out: %s", sample.key, error)
                    continue
                if state != self._wanted:
                    self._wanted = state
                    self._fetches_failed = 0
                    stand_in = {state.before} if self.model is None else set()
                    self._refusals.forget_all_but({state.in_force, state.canary} | stand_in)
                    self._heard.set()

    async def _apply(self, state: ModelRegistry) -> float:
        """Run what a state says, as far as it can be had; return seconds until something is to be tried again."""
        try:
            self._end_canary(state)
            base = await self._have(state, state.in_force, "in_force")
            if not state.in_force:
                await self._stand_in(state)
                going_on = "" if self.model is None else f", {self.model.in_force.label} goes on"
                self._note("in_force", NONE_IN_FORCE.replace(":", f"{going_on}:", 1))
            self._change(state, base)
            await self._remember(state)
            if self.model is not None:
                canary = await self._have(state, state.canary, "canary")
                self._change(state, None, canary)
                await self._remember(state)
        except _SupersededError:
            return math.inf
        except _RetryError:
            wait_s = growing_wait_s(self._fetches_failed, RETRY_S, MOST_RETRY_S)
        else:
            blind = self.model is None
            tried = {state.in_force, state.before if blind else state.canary} - self._running
            wait_s = self._refusals.wait_s(tried, blind=blind)
        self._close_spare()
        return wait_s

    @property
    def _running(self) -> set[str]:
        models = () if self.model is None else (self.model.in_force, self.model.canary)
        return {each.digest for each in models if each is not None}

    def _close_spare(self) -> None:
        for unused in self._spare.values():
            unused.model.close()
        self._spare.clear()

    def _end_canary(self, state: ModelRegistry) -> None:
        """End or restrict the canary first: what follows may take long."""
        canary = None if self.model is None else self.model.canary
        if canary is not None and canary.digest != state.in_force:
            self._change(state, None)

    def _change(self, state: ModelRegistry, base: LoadedModel | None, canary: LoadedModel | None = None) -> None:
        """Swap models. Without a new one in force the one before goes on."""
        if self.model is None and base is not None:
            self.model = FleetModel(base, self._refusals.works, self._failed)
            self._ready.set()
        if self.model is None:
            return
        before, old_canary = self.model.in_force, self.model.canary
        if base is not None and base is not before:
            log.info("%s takes over from %s", base.label, before.label)
        if canary is None and old_canary is not None and old_canary.digest == state.canary:
            canary = old_canary  # it goes on while the one in force changes
        if canary is not None and canary is not old_canary:
            log.info("%s is the canary for %s", canary.label, ", ".join(state.robots))
        self.model.change(base or before, canary, state.robots)
        self.model.notes = self.notes
        for each in (base, canary):
            if each is not None:
                self._spare.pop(each.digest, None)

    def _failed(self, loaded: LoadedModel, error: ModelError) -> None:
        """Refuse a model that failed while it was used."""
        self._refusals.refuse(loaded.digest, first_line(error))
        self._heard.set()

    async def _remember(self, state: ModelRegistry) -> None:
        """Note what is run now for the next start."""
        if self.model is None:
            return
        canary = "" if self.model.canary is None else self.model.canary.digest
        run = msgspec.structs.replace(state, in_force=self.model.in_force.digest, canary=canary)
        if run != self._last and run.find(run.in_force) is not None:
            self._last = run
            await asyncio.to_thread(self._cache.remember, run)

    async def _have(self, state: ModelRegistry, digest: str, slot: Slot) -> LoadedModel | None:
        """Return a model, loaded; None if there is none, or it is refused. Raises _RetryError, _SupersededError."""
        published = state.find(digest)
        self._note(slot, "")
        if published is None:
            return None
        used: list[LoadedModel | None] = [] if self.model is None else [self.model.in_force, self.model.canary]
        for loaded in (*used, self._spare.get(digest)):
            if loaded is not None and loaded.digest == digest:
                return loaded
        if self._refusals.why(digest, blind=self.model is None) is None:
            await self._fetch(state, published, slot)
            if (ready := await self._loaded(state, published, slot)) is not None:
                return ready
        why = self._refusals.why(digest, blind=False)
        if slot == "in_force":
            await self._stand_in(state, fetch=True)
        goes_on = "" if self.model is None else f", {self.model.in_force.label} goes on"
        self._note(slot, f"{published.label} is refused{goes_on}: {why}", logging.ERROR)
        return None

    async def _loaded(self, state: ModelRegistry, published: PublishedModel, slot: Slot) -> LoadedModel | None:
        """Load a model from the cache; return None, and refuse it, if that fails. Raises _SupersededError."""
        digest, path, loop = published.digest, self._cache.path(published), asyncio.get_running_loop()
        self._note(slot, f"{published.label} is being loaded")
        await asyncio.to_thread(self._refusals.trying, digest)
        try:
            model = await loop.run_in_executor(self._executor, self._load, path)
        except Exception as error:  # noqa: BLE001 - whatever ails a new model, another one goes on
            given = f"--model {path}"
            self._refusals.refuse(digest, first_line(error).removeprefix(f"{given}: ").replace(given, "it"))
            return None
        self._spare[digest] = loaded = LoadedModel(digest, model.name, model)
        self._note(slot, "")
        self._check_wanted(state)
        return loaded

    async def _stand_in(self, state: ModelRegistry, *, fetch: bool = False) -> None:
        """Where no model runs, run one that ran here or was in force before. fetch: also one not in the cache."""
        last = self._last or state
        for known, digest in ((last, last.in_force), (last, last.before), (state, state.before)):
            published = known.find(digest)
            if self.model is not None or published is None or digest == state.in_force:
                continue
            if self._refusals.why(digest, blind=True) is not None:
                continue
            if not await asyncio.to_thread(self._cache.holds, published):
                if not fetch or known is not self._wanted:
                    continue
                await self._fetch(state, published, "in_force")
            self._change(state, self._spare.get(digest) or await self._loaded(state, published, "in_force"))

    def _check_wanted(self, state: ModelRegistry) -> None:
        if self._wanted is not None and self._wanted is not state:
            raise _SupersededError

    async def _fetch(self, state: ModelRegistry, model: PublishedModel, slot: Slot) -> None:
        """See that a model is in the cache. Raises _RetryError, _SupersededError."""
        if await asyncio.to_thread(self._cache.holds, model):
            return
        if slot == "in_force" and model.digest == state.in_force:
            await self._stand_in(state)
        if self._wanted is None:  # at the start, from the cache alone
            self._note(slot, f"{model.label} {NOT_IN_CACHE}")
            raise _RetryError
        told, came = 0, False

        def progress(there: int) -> None:
            nonlocal told, came
            came = True
            self._check_wanted(state)
            percent = 100 * there // model.size
            note = f"{model.label} is being fetched: {percent} % of {model.size / 1e6:.1f} MB"
            self._note(slot, note, logging.INFO if percent >= told else logging.DEBUG)
            if percent >= told:
                told = percent - percent % STEP + STEP

        try:
            await self._cache.fill(model, lambda file: fetch_rest(self._bus, model, file, progress))
        except (RequestError, SchemaError, DamagedModelError, OSError) as error:
            goes_on = came and not isinstance(error, DamagedModelError)
            self._fetches_failed = 1 if goes_on else self._fetches_failed + 1
            why = f"--cache {self._cache.folder}: {error.strerror}" if isinstance(error, OSError) else error
            self._note(slot, f"{model.label} cannot be fetched, and is asked for again: {why}", logging.WARNING)
            raise _RetryError from error

    def _note(self, slot: Slot, note: str, level: int = logging.INFO) -> None:
        """Set the remark on the model in force or the canary, or remove it; log a new one."""
        self._notes.pop(slot, None)
        if note:
            self._notes[slot] = note
            if note != self._logged:
                log.log(level, "%s", note)
                self._logged = note
        if self.model is not None:
            self.model.notes = self.notes
