"""The model of a roll-out: the one in force for all cameras, and a canary for those of single robots.

Models change between calls: calls in flight end with the model that they began with. A canary that fails, and a model
in force that fails at its first images, give way to one that works, which looks at these images instead.
"""

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Final

import msgspec

from bus.sharing.watchdog import CHECK_S, HUNG
from schemas.tuning import Tuning
from services.detector.model import (
    NO_MASKS,
    NO_MASKS_OF_POSES,
    DetectedObjects,
    Model,
    ModelError,
    Outcome,
    Request,
    TuningError,
)

log = logging.getLogger(__name__)

TRIAL_S: Final = HUNG * CHECK_S / 2
"""Seconds that a call may take where another model can answer instead: that is before the worker counts as hung."""

BOXES_ONLY: Final = {
    NO_MASKS: "no masks are drawn, distances and objects are not published",
    NO_MASKS_OF_POSES: "no masks are drawn, and objects are not published",
}


@dataclass(frozen=True, slots=True, eq=False)
class LoadedModel:
    """A published model that is ready. label: how the registry and results call it."""

    digest: str
    label: str
    model: Model


class FleetModel:
    """Implements `Model` with the models that a roll-out chooses.

    segments: overlays with masks are always offered, as the next model may have masks. notes: remarks about the
    roll-out, such as which model was refused. works: is told a model's digest whenever it has found an image's objects.
    fails: is told of a model that failed and why, when another one has taken its place.
    """

    segments = True

    def __init__(
        self,
        in_force: LoadedModel,
        works: Callable[[str], None] = lambda _: None,
        fails: Callable[[LoadedModel, ModelError], None] = lambda *_: None,
    ) -> None:
        self.in_force = in_force
        self.canary: LoadedModel | None = None
        self.robots: frozenset[str] = frozenset()
        self.notes: tuple[str, ...] = ()
        self.in_flight = in_force.model.in_flight
        self._works = works
        self._fails = fails
        self._tuned: Tuning | None = None
        self._untuned: dict[LoadedModel, str] = {}
        self._calls = Counter[LoadedModel]()
        self._proven: set[LoadedModel] = set()
        self._before: LoadedModel | None = None

    @property
    def name(self) -> str:
        """Label of the model in force."""
        return self.in_force.label

    @property
    def runtime(self) -> str:
        """That of the model in force."""
        return self.in_force.model.runtime

    @property
    def max_batch(self) -> int:
        """See `Model.max_batch`."""
        return min(each.model.max_batch for each in self._loaded())

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `Model.remarks`."""
        of_models = (_of_any_model(remark) for each in self._loaded() for remark in each.model.remarks)
        untuned = (self._untuned[each] for each in self._loaded() if each in self._untuned)
        return tuple(dict.fromkeys((*self.notes, *untuned, *of_models)))

    @property
    def tuning(self) -> Tuning:
        """See `Model.tuning`."""
        return self.in_force.model.tuning

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the classes that either model reports."""
        return tuple(dict.fromkeys(name for each in self._loaded() for name in each.model.classes))

    def tune(self, tuning: Tuning) -> None:
        """See `Model.tune`. Models that come later follow it as far as they can."""
        self.in_force.model.tune(tuning)
        self._tuned = self.in_force.model.tuning
        for each in self._kept():
            if each is not self.in_force:
                self._tune_alike(each)

    def change(self, in_force: LoadedModel, canary: LoadedModel | None = None, robots: Collection[str] = ()) -> None:
        """Use other models from the next call on; those no longer used are closed once their calls have ended.

        A model that works is kept until the one that follows it has found an image's objects.
        """
        before = self._kept()
        if in_force in self._proven:
            self._before = None
        elif self.in_force in self._proven:
            self._before = self.in_force
        self.in_force, self.canary, self.robots = in_force, canary, frozenset(robots) if canary else frozenset()
        for each in self._loaded():
            if each not in before:
                self._tune_alike(each)
        for each in before:
            self._close_unused(each)

    def close(self) -> None:
        """See `Model.close`."""
        for each in (*self._kept(), *self._calls):
            each.model.close()

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`. A batch is split by model."""
        chosen = [self._model_for(request) for request in batch]
        outcomes: dict[int, Outcome] = {}

        async def look(loaded: LoadedModel) -> None:
            places = [n for n, each in enumerate(chosen) if each is loaded]
            outcomes.update(zip(places, await self._found(loaded, [batch[n] for n in places]), strict=True))

        with self._calling(*chosen):  # at once: a model that changes before the calls begin stays open for them
            try:
                async with asyncio.TaskGroup() as group:
                    for loaded in dict.fromkeys(chosen):
                        group.create_task(look(loaded))
            except ExceptionGroup as failed:
                raise failed.exceptions[0] from failed
        return [outcomes[n] for n in range(len(batch))]

    async def _found(self, loaded: LoadedModel, batch: Sequence[Request]) -> Sequence[Outcome]:
        """Return a model's outcomes; if it fails, those of the one that is in force instead."""
        try:
            with self._calling(loaded):
                found = await self._called(loaded, batch)
        except ModelError as error:
            used = loaded in self._loaded()
            instead = self._instead_of(loaded)
            if instead is None:
                raise
            if used:
                self._fails(loaded, error)
            log.error("%s is no longer used, %s answers: %s", loaded.label, instead.label, error)  # noqa: TRY400
            return await self._found(instead, batch)
        if any(isinstance(each, DetectedObjects) for each in found):
            self._has_worked(loaded)
        return [_named(each, loaded.label) for each in found]

    async def _called(self, loaded: LoadedModel, batch: Sequence[Request]) -> Sequence[Outcome]:
        if loaded is self.in_force and self._before is None:  # if it hangs, the worker's watchdog sees it
            return await loaded.model.infer(batch)
        try:
            async with asyncio.timeout(TRIAL_S):
                return await loaded.model.infer(batch)
        except TimeoutError as error:
            raise ModelError(f"{loaded.label} has not answered for {TRIAL_S:g} s") from error

    def _instead_of(self, failed: LoadedModel) -> LoadedModel | None:
        """Stop using a model that failed; return the one that answers instead, None if there is none."""
        if failed is self.in_force:
            if self._before is None:
                return None
            self.change(self._before, self.canary, self.robots)
        elif failed is self.canary:
            self.change(self.in_force)
        return self.in_force

    def _has_worked(self, loaded: LoadedModel) -> None:
        self._works(loaded.digest)
        if loaded not in self._kept():
            return
        self._proven.add(loaded)
        if loaded is self.in_force and (before := self._before) is not None:
            self._before = None
            self._close_unused(before)

    def _loaded(self) -> tuple[LoadedModel, ...]:
        return (self.in_force,) if self.canary is None else (self.in_force, self.canary)

    def _kept(self) -> tuple[LoadedModel, ...]:
        return self._loaded() if self._before is None else (*self._loaded(), self._before)

    def _model_for(self, request: Request) -> LoadedModel:
        return self.canary if self.canary is not None and request.camera.robot in self.robots else self.in_force

    @contextmanager
    def _calling(self, *models: LoadedModel) -> Iterator[None]:
        self._calls.update(models)
        try:
            yield
        finally:
            self._calls.subtract(models)
            for each in dict.fromkeys(models):
                self._close_unused(each)

    def _close_unused(self, loaded: LoadedModel) -> None:
        if loaded not in self._kept() and not self._calls[loaded]:
            del self._calls[loaded]
            self._proven.discard(loaded)
            self._untuned.pop(loaded, None)
            loaded.model.close()

    def _tune_alike(self, loaded: LoadedModel) -> None:
        """Have a model follow the settings of a request, but for classes that it lacks."""
        self._untuned.pop(loaded, None)
        if self._tuned is None:
            return
        try:
            loaded.model.tune(self._tuned)
        except TuningError as error:
            loaded.model.tune(msgspec.structs.replace(self._tuned, classes=None))
            note = f"{loaded.label} reports the configured classes, not those of a request: {error}"
            self._untuned[loaded] = note
            log.warning("%s", note)


def _of_any_model(remark: str) -> str:
    """Return a model's remark as it holds where overlays are offered whether it has masks or not."""
    for silent, boxes_only in BOXES_ONLY.items():
        if remark.endswith(silent):
            return remark.removesuffix(silent) + boxes_only
    return remark


def _named(outcome: Outcome, label: str) -> Outcome:
    """Return an outcome that says which model it is of."""
    return replace(outcome, model=label) if isinstance(outcome, DetectedObjects) else outcome
