"""Lets a world model, and today's map of the monitor, see recorded drives, and scores what they know."""

import copy
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from benchmarks.worldmodel.changes import ChangeScore, ChangeWatch, StandingScore
from benchmarks.worldmodel.recording import RecordedChanges, RecordedRound, TrueObject
from benchmarks.worldmodel.replay import Replayed, replay
from benchmarks.worldmodel.scoring import FoundObject, IdentityScore, InventoryScore, asked_for
from schemas.distances import CameraView
from schemas.world import ChangeKind, WorldChange
from services.monitor.map.last_seen import SightingMap
from services.simulator.localisation import Drift, Lost
from services.worldmodel.events import Event
from services.worldmodel.model import SiteModel
from services.worldmodel.published_objects import PublishedObjects

LOOK_EVERY_S: Final = 2.0
"""Seconds between two comparisons of ids."""

NS: Final = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Drives:
    """So many seconds of rounds through the warehouse of a seed."""

    seed: int
    seconds: float
    rounds: Sequence[RecordedRound]


@dataclass(slots=True)
class Scores:
    """The scores of one model over all warehouses."""

    inventory: InventoryScore = field(default_factory=InventoryScore)
    purities: list[float] = field(default_factory=list)
    standing: StandingScore = field(default_factory=StandingScore)
    changes: ChangeScore = field(default_factory=ChangeScore)

    def summary(self) -> dict[str, Any]:
        """Return the figures by name."""
        purity = round(sum(self.purities) / len(self.purities), 3) if self.purities else None
        return {**self.inventory.summary(), "id_purity": purity}


def drive(
    drives: Drives,
    drift: Drift,
    world: Scores,
    merging: Scores | None = None,
    keep: Collection[float] = (),
) -> dict[float, "World"]:
    """Drive for so long, and compare each model with the truth as it goes, and at the end.

    keep: seconds. Return the world model as it was then.
    """
    true, model, places = _truth(drives), World(), _Places()
    ids = {"world": IdentityScore(), "places": IdentityScore()}
    looked_s = before_s = 0.0
    kept: dict[float, World] = {}
    for replayed in replay(drives.rounds, drives.seconds, drift, drives.seed):
        kept |= {second: copy.deepcopy(model) for second in keep if before_s < second <= replayed.second}
        changes = model.take(replayed)
        _add_standing(world.standing, changes, model, list(true.values()), replayed.second - before_s)
        before_s = replayed.second
        if merging is not None:
            places.take(replayed)
        if replayed.second - looked_s >= LOOK_EVERY_S / len(drives.rounds):
            looked_s = replayed.second
            ids["world"].add(replayed.image, true, model.found())
    _note(world, drives, model.found(), ids["world"])
    if merging is not None:
        _note(merging, drives, places.found(drives.seconds), ids["places"])
    return kept


def drive_lost(drives: Drives, drift: Drift, model: "World", lost: Lost, scores: Scores) -> None:
    """Drive on with a model from when a robot is lost."""
    true, before_s = list(_truth(drives).values()), lost.begins_s
    for replayed in replay(drives.rounds, drives.seconds, drift, drives.seed, lost=[lost], since_s=lost.begins_s):
        _add_standing(scores.standing, model.take(replayed), model, true, replayed.second - before_s)
        before_s = replayed.second
    _note(scores, drives, model.found(), IdentityScore())


def drive_changes(drives: Drives, drift: Drift, model: "World", recorded: RecordedChanges, scores: Scores) -> None:
    """Drive on with a model, from when so many seconds are over, while the warehouse changes."""
    watch, before_s = ChangeWatch(recorded, scores.changes), drives.seconds
    for replayed in replay(
        drives.rounds, drives.seconds, drift, drives.seed, then=recorded.images, since_s=drives.seconds
    ):
        changes = model.take(replayed)
        watch.add(replayed.image, model.found())
        _add_standing(scores.standing, changes, model, watch.resting, replayed.second - before_s, still=False)
        before_s = replayed.second
    watch.end(before_s - drives.seconds)


def _truth(drives: Drives) -> dict[int, TrueObject]:
    return {each.instance: each for of in drives.rounds for each in of.objects}


def _add_standing(
    score: StandingScore,
    changes: Sequence[WorldChange],
    model: "World",
    true: Sequence[TrueObject],
    passed_s: float,
    *,
    still: bool = True,
) -> None:
    minutes = model.count * passed_s / 60
    score.object_minutes += minutes
    score.still_minutes += minutes if still else 0.0
    for change in changes:
        if change.kind is ChangeKind.MOVED:
            score.false_moved += still
        elif change.kind is ChangeKind.GONE:
            gone = FoundObject(change.object.id, change.object.name, change.object.at)
            score.add_gone(gone, model.found(), true)


def _note(scores: Scores, drives: Drives, found: Sequence[FoundObject], ids: IdentityScore) -> None:
    asked = asked_for(image for of in drives.rounds for image in of.images)
    scores.inventory.add(list(_truth(drives).values()), asked, found)
    if ids.purity is not None:
        scores.purities.append(ids.purity)


class World:
    """The world model. identify: see `SiteModel`."""

    def __init__(self, identify: Callable[[CameraView, Mapping[int, int]], None] | None = None) -> None:
        self.model = SiteModel(identify=identify)
        self._published = PublishedObjects("hall", "b", self.model)

    def take(self, replayed: Replayed) -> list[WorldChange]:
        """Take an image in, and return what changed."""
        return [self._published.change(event) for event in self.events(replayed)]

    def events(self, replayed: Replayed) -> list[Event]:
        """Take an image in, and return what changed, by the numbers of objects."""
        return self.model.take(replayed.view, NS + round(replayed.second * NS))

    @property
    def count(self) -> int:
        """How many objects it knows."""
        return int(self.model.objects.confirmed.sum())

    def found(self) -> list[FoundObject]:
        """Return the objects that it knows."""
        objects = self.model.objects
        rows = objects.known()
        known = (self._published.object(int(row)) for row in rows[objects.confirmed[rows]])
        return [FoundObject(each.id, each.name, each.at) for each in known]


class _Places:
    """Today's map of the monitor."""

    def __init__(self) -> None:
        self._map = SightingMap()

    def take(self, replayed: Replayed) -> None:
        self._map.take(replayed.distances(), NS + round(replayed.second * NS))

    def found(self, second: float) -> list[FoundObject]:
        marks = self._map.marks(NS + round(second * NS))
        return [FoundObject(str(number), mark.name, (mark.x, mark.y)) for number, mark in enumerate(marks)]
