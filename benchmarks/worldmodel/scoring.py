"""Compares what a model of a warehouse knows with what truly is there. Pure."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.identities import assigned
from benchmarks.worldmodel.recording import LEAST_SHARE, NOTHING, RecordedImage, TrueObject

LEAST_VISIBILITY: Final = 0.5
LEAST_IMAGES: Final = 3
"""An object is there to be found when it was at least so much of an image, and visible so far, in so many images."""

REACH_M: Final = {"forklift": 1.0}
REACH_ELSE_M: Final = 0.5
"""How far the centre of what was found may be from a true object's, by class."""

FAR_M: Final = 1e6
"""A distance next to which reaches are nothing: a pair more outweighs all that others are nearer."""


@dataclass(frozen=True, slots=True)
class FoundObject:
    """An object that a model knows. at: its centre in the map, x, y, z in metres, or x, y alone."""

    id: str
    name: str
    at: tuple[float, ...]


def asked_for(images: Iterable[RecordedImage]) -> set[int]:
    """Return the numbers of the objects that are there to be found."""
    counts = Counter(
        seen.instance
        for image in images
        for seen in image.visible
        if seen.image_share >= LEAST_SHARE and seen.visibility >= LEAST_VISIBILITY
    )
    return {instance for instance, count in counts.items() if count >= LEAST_IMAGES}


@dataclass(slots=True)
class InventoryScore:
    """Counts by class: of objects asked for, of those found, of found objects, of wrong ones and of doubles.

    wrong: found objects that lie on no true one of their class that is left. doubles: those of them that lie on one
    which another found object has already. errors_m: how far the centres of matched ones are apart. exact: in how many
    warehouses the count of a class was right.
    """

    asked: Counter[str] = field(default_factory=Counter)
    matched: Counter[str] = field(default_factory=Counter)
    found: Counter[str] = field(default_factory=Counter)
    wrong: Counter[str] = field(default_factory=Counter)
    doubles: Counter[str] = field(default_factory=Counter)
    errors_m: list[float] = field(default_factory=list)
    exact: Counter[str] = field(default_factory=Counter)
    warehouses: int = 0

    def add(self, true: Sequence[TrueObject], asked: set[int], found: Sequence[FoundObject]) -> None:
        """Count one warehouse. Found objects on true ones that are not asked for are neither right nor wrong."""
        self.warehouses += 1
        for name in sorted({each.name for each in true} | {each.name for each in found}):
            wanted = [each for each in true if each.name == name and each.instance in asked]
            others = [each for each in true if each.name == name and each.instance not in asked]
            own = [each for each in found if each.name == name]
            self._add_class(name, wanted, others, own)

    def _add_class(self, name: str, wanted: list[TrueObject], others: list[TrueObject], own: list[FoundObject]) -> None:
        pairs = matched(own, wanted)
        left = [each for number, each in enumerate(own) if number not in {row for row, _, _ in pairs}]
        ignored = {row for row, _, _ in matched(left, others)}
        wrong = [each for number, each in enumerate(left) if number not in ignored]
        self.asked[name] += len(wanted)
        self.matched[name] += len(pairs)
        self.found[name] += len(pairs) + len(wrong)
        self.wrong[name] += len(wrong)
        self.doubles[name] += sum(bool(matched([each], wanted + others)) for each in wrong)
        self.errors_m += [distance for _, _, distance in pairs]
        self.exact[name] += len(wanted) == len(pairs) + len(wrong)

    @property
    def f1(self) -> float | None:
        """Of all classes together."""
        total = self.asked.total() + self.found.total()
        return round(2 * self.matched.total() / total, 3) if total else None

    def summary(self) -> dict[str, Any]:
        """Return the figures by name."""
        errors = np.array(self.errors_m or [np.nan])
        return {
            "inventory_f1": self.f1,
            "recall": _share(self.matched.total(), self.asked.total()),
            "precision": _share(self.matched.total(), self.found.total()),
            "count_error": {
                name: _share(abs(self.found[name] - count), count) for name, count in sorted(self.asked.items())
            },
            "asked_for": dict(sorted(self.asked.items())),
            "found": dict(sorted(self.found.items())),
            "wrong": dict(sorted(self.wrong.items())),
            "duplicates": _share(self.doubles.total(), self.found.total()),
            "exact": {name: self.exact[name] for name in sorted(self.asked)},
            "position_error_p50_m": _rounded(np.percentile(errors, 50)),
            "position_error_p95_m": _rounded(np.percentile(errors, 95)),
        }


def matched(found: Sequence[FoundObject], true: Sequence[TrueObject]) -> list[tuple[int, int, float]]:
    """Return pairs (found, true, metres) within reach, one to one, as many as can be and the nearest ones."""
    if not found or not true:
        return []
    axes = len(found[0].at)
    there = np.array([each.at for each in found])
    places = np.array([each.centre[:axes] for each in true])
    reach = np.array([REACH_M.get(each.name, REACH_ELSE_M) for each in true])
    apart = np.linalg.norm(there[:, None] - places[None], axis=2)
    pairs = assigned(np.where(apart <= reach, FAR_M - apart, 0.0))
    return [(row, column, float(apart[row, column])) for row, column in pairs]


@dataclass(slots=True)
class IdentityScore:
    """Which object of the model each sighting of a true object belonged to, by the places of both.

    names: of a true object's sightings, how many were of each id.
    """

    names: dict[int, Counter[str]] = field(default_factory=dict)

    def add(self, image: RecordedImage, true: Mapping[int, TrueObject], found: Sequence[FoundObject]) -> None:
        """Count the sightings of an image, with what the model knew then."""
        seen = [true[instance] for instance in sorted(set(image.shown) - {NOTHING}) if instance in true]
        for name in {each.name for each in seen}:
            own = [each for each in found if each.name == name]
            shown = [each for each in seen if each.name == name]
            for row, column, _ in matched(own, shown):
                self.names.setdefault(shown[column].instance, Counter())[own[row].id] += 1

    @property
    def purity(self) -> float | None:
        """The share of sightings whose object went by its usual id, which is no other object's usual one."""
        usual = {instance: counts.most_common(1)[0] for instance, counts in self.names.items()}
        owners: dict[str, tuple[int, int]] = {}
        for instance, (name, count) in usual.items():
            owners[name] = max(owners.get(name, (0, -1)), (count, instance))
        right = sum(count for instance, (name, count) in usual.items() if owners[name][1] == instance)
        total = sum(counts.total() for counts in self.names.values())
        return round(right / total, 3) if total else None


def _share(part: float, whole: float) -> float | None:
    return round(part / whole, 3) if whole else None


def _rounded(value: NDArray[Any] | float) -> float | None:
    return round(float(value), 3) if np.isfinite(value) else None
