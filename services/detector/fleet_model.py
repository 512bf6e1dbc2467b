"""The model of a roll-out: the one in force for all cameras, and a canary for those of single robots.

Models change between calls: calls in flight end with the model that they began with.
"""

import asyncio
import logging
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Final

from schemas.tuning import Tuning
from services.detector.model import SILENT, DetectedObjects, Model, Outcome, Request, TuningError

log = logging.getLogger(__name__)

BOXES_ONLY: Final = "no masks are drawn, distances and objects are silent"


@dataclass(frozen=True, slots=True, eq=False)
class LoadedModel:
    """A published model that is ready. label: how the registry and results call it."""

    digest: str
    label: str
    model: Model


class FleetModel:
    """Implements `Model` with the models that a roll-out chooses.

    segments: overlays with masks are always offered, as the next model may have masks. notes: remarks about the
    roll-out, such as which model was refused.
    """

    segments = True

    def __init__(self, in_force: LoadedModel) -> None:
        self.in_force = in_force
        self.canary: LoadedModel | None = None
        self.robots: frozenset[str] = frozenset()
        self.notes: tuple[str, ...] = ()
        self.in_flight = in_force.model.in_flight
        self._tuned: Tuning | None = None
        self._calls = Counter[LoadedModel]()

    @property
    def name(self) -> str:
        """Label of the model in force."""
        return self.in_force.label

    @property
    def max_batch(self) -> int:
        """See `Model.max_batch`."""
        return min(each.model.max_batch for each in self._loaded())

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `Model.remarks`."""
        of_models = (_of_any_model(remark) for each in self._loaded() for remark in each.model.remarks)
        return tuple(dict.fromkeys((*self.notes, *of_models)))

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
        if self.canary is not None:
            self._tune_alike(self.canary)

    def change(self, in_force: LoadedModel, canary: LoadedModel | None = None, robots: Collection[str] = ()) -> None:
        """Use other models from the next call on; those no longer used are closed once their calls have ended."""
        before = self._loaded()
        self.in_force, self.canary, self.robots = in_force, canary, frozenset(robots) if canary else frozenset()
        for each in self._loaded():
            if each not in before:
                self._tune_alike(each)
        for each in before:
            self._close_unused(each)

    def close(self) -> None:
        """See `Model.close`."""
        for each in (*self._loaded(), *self._calls):
            each.model.close()

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`. A batch is split by model."""
        chosen = [self._model_for(request) for request in batch]
        outcomes: dict[int, Outcome] = {}

        async def look(loaded: LoadedModel) -> None:
            places = [n for n, each in enumerate(chosen) if each is loaded]
            with self._calling(loaded):
                found = await loaded.model.infer([batch[n] for n in places])
            outcomes.update(zip(places, (_named(each, loaded.label) for each in found), strict=True))

        try:
            async with asyncio.TaskGroup() as group:
                for loaded in dict.fromkeys(chosen):
                    group.create_task(look(loaded))
        except ExceptionGroup as failed:
            raise failed.exceptions[0] from failed
        return [outcomes[n] for n in range(len(batch))]

    def _loaded(self) -> tuple[LoadedModel, ...]:
        return (self.in_force,) if self.canary is None else (self.in_force, self.canary)

    def _model_for(self, request: Request) -> LoadedModel:
        return self.canary if self.canary is not None and request.camera.robot in self.robots else self.in_force

    @contextmanager
    def _calling(self, loaded: LoadedModel) -> Iterator[None]:
        self._calls[loaded] += 1
        try:
            yield
        finally:
            self._calls[loaded] -= 1
            self._close_unused(loaded)

    def _close_unused(self, loaded: LoadedModel) -> None:
        if loaded not in self._loaded() and not self._calls[loaded]:
            del self._calls[loaded]
            loaded.model.close()

    def _tune_alike(self, loaded: LoadedModel) -> None:
        if self._tuned is None:
            return
        try:
            loaded.model.tune(self._tuned)
        except TuningError as error:
            log.warning("%s keeps the configured settings, not those of a request: %s", loaded.label, error)


def _of_any_model(remark: str) -> str:
    """Return a model's remark as it holds where overlays are offered whether it has masks or not."""
    return remark.removesuffix(SILENT) + BOXES_ONLY if remark.endswith(SILENT) else remark


def _named(outcome: Outcome, label: str) -> Outcome:
    """Return an outcome that says which model it is of."""
    return replace(outcome, model=label) if isinstance(outcome, DetectedObjects) else outcome
