"""Which class names each detection model gives. Pure."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.worldmodel.classes import MAX_CLASSES
from services.worldmodel.frames import Frames
from services.worldmodel.placement import Sightings

Rows = NDArray[np.intp]

NAMED_NS: Final = 60_000_000_000
"""A model that never gave a class, in so long, is taken not to know it."""

NAMED_TIMES: Final = 5
"""A model that gave a class less often may have done so by mistake."""

MOST_MODELS: Final = 256


class Vocabulary:
    """Which classes each detection model gave, from all robots that run it."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}
        self._names: list[str] = []
        self._times = np.zeros((0, MAX_CLASSES), np.int64)
        self._since_ns = np.zeros(0, np.int64)

    def heed(
        self, frames: Frames, seen: Sightings, names: Sequence[str]
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Learn from views; return which classes their models gave (views, MAX_CLASSES), and since when each is known.

        seen: the views' sightings. names: of classes, by number; numbers may be another class's from then on.
        """
        if self._names != names:
            reused = [number for number, name in enumerate(self._names) if name != names[number]]
            self._times[:, reused] = 0
            self._names = list(names)
        numbers = self._of([view.model for view in frames.views], frames.at_ns)
        np.add.at(self._times, (numbers[seen.frame], seen.classes), 1)
        return self._times[numbers] >= NAMED_TIMES, self._since_ns[numbers]

    def known(self) -> dict[str, list[str]]:
        """Return the names of the classes that each model gave."""
        given = self._times >= NAMED_TIMES
        return {
            model: [name for name, has in zip(self._names, given[number].tolist(), strict=False) if has]
            for model, number in self._numbers.items()
        }

    def restore(self, known: Mapping[str, Sequence[str]], names: Sequence[str]) -> None:
        """Go on with what was known before, where nothing is. names: of classes, by number."""
        self._names = list(names)
        models = list(known)[:MOST_MODELS]
        numbers = self._of(models, np.zeros(0, np.int64)).tolist()
        for number, model in zip(numbers, models, strict=True):
            self._times[number, [names.index(each) for each in known[model] if each in names]] = NAMED_TIMES

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now: the clock was set back."""
        np.minimum(self._since_ns, now_ns, out=self._since_ns)

    def _of(self, models: Sequence[str], at_ns: NDArray[np.int64]) -> Rows:
        new = dict.fromkeys(each for each in models if each not in self._numbers)
        if len(self._numbers) + len(new) > MOST_MODELS:
            new = dict.fromkeys(models)
            self._numbers.clear()
            self._times, self._since_ns = self._times[:0], self._since_ns[:0]
        if new:
            self._numbers.update({name: len(self._numbers) + nth for nth, name in enumerate(new)})
            self._times = np.concatenate([self._times, np.zeros((len(new), MAX_CLASSES), np.int64)])
            self._since_ns = np.concatenate([self._since_ns, np.full(len(new), at_ns.max(initial=0))])
        return np.array([self._numbers[name] for name in models], np.intp)
