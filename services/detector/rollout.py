"""Follows the model registry: fetches what is in force, loads it beside the old model, and puts it in its place."""

import asyncio
import logging
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
from services.detector.fleet_model import FleetModel, LoadedModel
from services.detector.model import Model, first_line
from services.detector.model_cache import DamagedModelError, ModelCache
from services.model_registry.client import fetch_model

log = logging.getLogger(__name__)

RETRY_S: Final = 5.0
"""Seconds until a model that could not be fetched is asked for again."""

STEP: Final = 25
"""Percent of a file between two lines of the log."""

NOTHING_YET: Final = "waiting for a model: no monitor with --models is heard, and none was run here before"
NONE_IN_FORCE: Final = "no model is in force: `fleetsight model use NAME` puts one in force"

Slot = Literal["in_force", "canary"]

LoadModel = Callable[[Path], Model]
"""Loads weights; takes seconds, and raises ModelError."""


class _RetryError(Exception):
    """A model cannot be had now."""


class Rollout:
    """Keeps a FleetModel as the registry says.

    load, executor: how weights are loaded, and the thread for it. model: None until the first one is ready. A model
    that cannot be loaded is refused: the one before it goes on, and `notes` say why.
    """

    def __init__(self, bus: Bus, cache: ModelCache, load: LoadModel, executor: Executor) -> None:
        self._bus = bus
        self._cache = cache
        self._load = load
        self._executor = executor
        self.model: FleetModel | None = None
        self._wanted: ModelRegistry | None = None
        self._heard = asyncio.Event()
        self._ready = asyncio.Event()
        self._refused: dict[str, str] = {}
        self._notes: dict[Slot, str] = {}
        self._logged = ""
        self._remembered: ModelRegistry | None = None
        self._note("in_force", NOTHING_YET)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the roll-out for users: what is waited for, fetched or refused."""
        return tuple(self._notes.values())

    async def run(self) -> None:
        """Follow the registry until cancelled; begin with what was run here last."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._listen())
            if (last := await asyncio.to_thread(self._cache.recall)) is not None and self._wanted is None:
                await self._apply(last)
            while True:
                await self._heard.wait()
                self._heard.clear()
                if self._wanted is not None and not await self._apply(self._wanted):
                    with suppress(TimeoutError):
                        async with asyncio.timeout(RETRY_S):
                            await self._heard.wait()
                    self._heard.set()

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
                    self._heard.set()

    async def _apply(self, state: ModelRegistry) -> bool:
        """Run what a state says, as far as it can be had; return False where something is to be tried again."""
        self._refused = {
            digest: why for digest, why in self._refused.items() if digest in {state.in_force, state.canary}
        }
        try:
            base = await self._have(state, state.in_force, "in_force")
            if not state.in_force:
                self._note("in_force", NONE_IN_FORCE)
            self._change(state, base)
            await self._remember(state, base)
            canary = await self._have(state, state.canary, "canary")
            self._change(state, base, canary)
            await self._remember(state, base)
        except _RetryError:
            return False
        return True

    async def _remember(self, state: ModelRegistry, base: LoadedModel | None) -> None:
        """Note what runs now for a start without a monitor, if it is what is in force."""
        if self.model is None or base is None:
            return
        canary = self.model.canary
        run = msgspec.structs.replace(state, canary="" if canary is None else canary.digest)
        if run != self._remembered:
            await asyncio.to_thread(self._cache.remember, run)
            self._remembered = run

    def _change(self, state: ModelRegistry, base: LoadedModel | None, canary: LoadedModel | None = None) -> None:
        """Swap models. Without a new one in force the one before goes on."""
        if self.model is None and base is not None:
            self.model = FleetModel(base)
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

    async def _have(self, state: ModelRegistry, digest: str, slot: Slot) -> LoadedModel | None:
        """Return a model, loaded; None if there is none, or it is refused.

        Raises:
            _RetryError: it cannot be fetched now, or the registry says something else by now.
        """
        published = state.find(digest)
        self._note(slot, "")
        if published is None:
            return None
        for loaded in () if self.model is None else (self.model.in_force, self.model.canary):
            if loaded is not None and loaded.digest == digest:
                return loaded
        if digest not in self._refused:
            await self._fetch(published, slot)
            self._note(slot, f"{published.label} is being loaded")
            path, loop = self._cache.path(published), asyncio.get_running_loop()
            try:
                model = await loop.run_in_executor(self._executor, self._load, path)
            except Exception as error:  # noqa: BLE001 - whatever ails a new model, the old one goes on
                given = f"--model {path}"
                self._refused[digest] = first_line(error).removeprefix(f"{given}: ").replace(given, "it")
            else:
                self._note(slot, "")
                return LoadedModel(digest, model.name, model)
        goes_on = "" if self.model is None else f", {self.model.in_force.label} goes on"
        self._note(slot, f"{published.label} is refused{goes_on}: {self._refused[digest]}", logging.ERROR)
        return None

    async def _fetch(self, model: PublishedModel, slot: Slot) -> None:
        """See that a model is in the cache; raises _RetryError."""
        if await asyncio.to_thread(self._cache.holds, model):
            return
        if self._wanted is None:  # at the start, from the cache alone
            self._note(slot, NOTHING_YET)
            raise _RetryError
        told = 0

        def progress(there: int) -> None:
            nonlocal told
            if self._wanted is not None and model.digest not in {self._wanted.in_force, self._wanted.canary}:
                raise _RetryError
            percent = 100 * there // model.size
            note = f"{model.label} is being fetched: {percent} % of {model.size / 1e6:.1f} MB"
            self._note(slot, note, logging.INFO if percent >= told else logging.DEBUG)
            if percent >= told:
                told = percent - percent % STEP + STEP

        try:
            await self._cache.fill(model, lambda file: fetch_model(self._bus, model, file, progress))
        except (RequestError, SchemaError, DamagedModelError, OSError) as error:
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
