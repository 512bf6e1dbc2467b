"""Compares what a model says of a changing warehouse with what changed, and when a robot could see it. Pure."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import ceil, inf
from typing import Any, Final

import numpy as np

from benchmarks.worldmodel.recording import ObjectChange, RecordedChanges, RecordedImage, TrueObject, VisibleObject
from benchmarks.worldmodel.scoring import LEAST_VISIBILITY, REACH_ELSE_M, REACH_M, FoundObject, matched

TIME_TO_NOTICE_S: Final = 3.0
"""A change that is undone, or the recording's end, so soon after it could be seen says nothing."""

WELL_SHARE: Final = 0.005
"""Share of an image from which on it shows something well, if half of it is unhidden: 40 x 40 pixels of 640 x 480."""

LOOK_IMAGES: Final = 3
LOOK_S: Final = 2.0
"""So many images within so many seconds, of whatever robots, are a look at a place: less is a glance."""

SEEN_MOVING_S: Final = 1.5
"""What is at least half unhidden so often, from before it moves until it is there, is seen moving."""


@dataclass(slots=True)
class StandingScore:
    """How often a model says of what stands still that it is gone or has moved.

    object_minutes: of all its objects. still_minutes: of these, while nothing moved.
    """

    false_gone: int = 0
    false_moved: int = 0
    object_minutes: float = 0.0
    still_minutes: float = 0.0

    def add_gone(self, gone: FoundObject, found: Sequence[FoundObject], true: Sequence[TrueObject]) -> None:
        """Count an object that is told to be gone if nothing else that was found is the true one at its place."""
        there = [each for each in true if each.name == gone.name]
        others = [each for each in found if each.name == gone.name and each.id != gone.id]
        self.false_gone += len(matched([*others, gone], there)) > len(matched(others, there))

    def summary(self) -> dict[str, float | None]:
        """Return the figures, per object and minute, by name."""
        gone, moved = (self.false_gone, self.object_minutes), (self.false_moved, self.still_minutes)
        return {
            name: round(count / minutes, 4) if minutes else None
            for name, (count, minutes) in (("false_gone", gone), ("false_moved", moved))
        }


@dataclass(slots=True)
class _Awaited:
    """A change at a place that the model is to notice. id: of the object that leaves it; "" for one that comes.

    shown: seconds of the images that show the place well.
    """

    change: ObjectChange
    id: str
    shown: list[float] = field(default_factory=list)

    @property
    def since_s(self) -> float | None:
        """When the first look at the place began: LOOK_IMAGES within LOOK_S."""
        ends = self.shown[LOOK_IMAGES - 1 :]
        return next((begin for begin, end in zip(self.shown, ends, strict=False) if end - begin <= LOOK_S), None)


@dataclass(slots=True)
class ChangeScore:
    """How soon changes are noticed, and whether things keep their ids; of any number of warehouses.

    gone_s, new_s: seconds from the first image of the first look at a place that something has left, or has come to,
    until the model says so; infinite where it did not. Ids: of how many moved objects, and of how many it was right.
    """

    gone_s: list[float] = field(default_factory=list)
    new_s: list[float] = field(default_factory=list)
    seen_moving: int = 0
    kept_id: int = 0
    moved_unseen: int = 0
    new_id: int = 0

    def summary(self) -> dict[str, Any]:
        """Return the figures by name."""
        every = self.gone_s + self.new_s
        return {
            "changes": len(every),
            "noticed": round(float(np.isfinite(every).mean()), 3) if every else None,
            "noticed_p50_s": _percentile(every, 0.5),
            "noticed_p95_s": _percentile(every, 0.95),
            "gone_p95_s": _percentile(self.gone_s, 0.95),
            "new_p95_s": _percentile(self.new_s, 0.95),
            "seen_moving": self.seen_moving,
            "moved_seen_kept_id": _share(self.kept_id, self.seen_moving),
            "moved_unseen": self.moved_unseen,
            "moved_unseen_new_id": _share(self.new_id, self.moved_unseen),
        }


class ChangeWatch:
    """Follows one recording of a warehouse that changes, and counts into a score."""

    def __init__(self, recorded: RecordedChanges, score: ChangeScore) -> None:
        self._score = score
        self._coming = sorted(recorded.changes, key=lambda each: each.begins_s)[::-1]
        self._resting = {each.instance: each for each in recorded.objects}
        self._moving: list[ObjectChange] = []
        self._ids: dict[int, str] = {}
        self._left: dict[int, _Awaited] = {}
        self._come: dict[int, _Awaited] = {}
        self._sights: dict[int, list[tuple[float, bool]]] = {}
        self._found: Sequence[FoundObject] = ()

    @property
    def resting(self) -> list[TrueObject]:
        """What stands still where it is said to be."""
        return list(self._resting.values())

    def add(self, image: RecordedImage, found: Sequence[FoundObject]) -> None:
        """Go on to an image, with what the model knows once it has taken it in."""
        second = image.second
        while self._coming and self._coming[-1].begins_s <= second:
            self._begin(self._coming.pop())
        for change in [each for each in self._moving if each.ends_s <= second]:
            self._moving.remove(change)
            self._end(change)
        for seen in image.visible:
            if seen.instance in self._sights:
                self._sights[seen.instance].append((second, seen.visibility >= LEAST_VISIBILITY))
        _note_shown(self._left, image.missing, second)
        _note_shown(self._come, image.visible, second)
        for instance, awaited in list(self._left.items()):
            if not _is_at(awaited, found):
                self._settle(self._left.pop(instance), second, self._score.gone_s)
        for instance, awaited in list(self._come.items()):
            name = self._name_of(awaited.change, found)
            if name is not None:
                self._settle(self._come.pop(instance), second, self._score.new_s)
                self._compare(awaited.change, name)
        self._found = found

    def end(self, second: float) -> None:
        """Give up on what was not noticed by the end."""
        for instance in [*self._left]:
            self._give_up(self._left, instance, second, self._score.gone_s)
        for instance in [*self._come]:
            self._give_up(self._come, instance, second, self._score.new_s)

    def _begin(self, change: ObjectChange) -> None:
        instance = change.instance
        self._give_up(self._left, instance, change.begins_s, self._score.gone_s)
        self._give_up(self._come, instance, change.begins_s, self._score.new_s)
        if change.before is not None:
            known = self._name_of(change, self._found)
            self._ids.pop(instance, None)
            if known is not None:
                self._ids[instance] = known
                self._left[instance] = _Awaited(change, known)
            self._sights[instance] = []
        self._resting.pop(instance, None)
        self._moving.append(change)

    def _end(self, change: ObjectChange) -> None:
        instance = change.instance
        if change.after is None:
            return
        there = TrueObject(instance=instance, name=change.name, centre=change.after, size=(0.0, 0.0, 0.0))
        self._resting[instance] = there
        if change.before is None or _apart(change.before, change.after) > _reach(change.name):
            self._come[instance] = _Awaited(change, "")
        else:  # it is back where it was
            self._left.pop(instance, None)

    def _name_of(self, change: ObjectChange, found: Sequence[FoundObject]) -> str | None:
        """Return the id that the model has for an object where it rests, if it knows it there."""
        there = [each for each in self._resting.values() if each.name == change.name]
        own = [each for each in found if each.name == change.name]
        pairs = matched(own, there)
        return next((own[row].id for row, column, _ in pairs if there[column].instance == change.instance), None)

    def _compare(self, change: ObjectChange, now: str) -> None:
        before = self._ids.get(change.instance)
        sights = self._sights.get(change.instance, [])
        if before is None:
            return
        if change.before is None or not any(second <= change.ends_s for second, _ in sights):
            self._score.moved_unseen += 1
            self._score.new_id += now != before
            return
        times = [change.begins_s, *(second for second, well in sights if well)]
        there = next((number for number, second in enumerate(times) if second >= change.ends_s), 0)
        if there and max(np.diff(times[: there + 1])) <= SEEN_MOVING_S:
            self._score.seen_moving += 1
            self._score.kept_id += now == before

    @staticmethod
    def _settle(awaited: _Awaited, second: float, noted: list[float]) -> None:
        """Note how long it took, also where there was no more than a glance."""
        glance = next((each for each in awaited.shown if each >= second - LOOK_S), second)
        noted.append(second - (glance if awaited.since_s is None else awaited.since_s))

    @staticmethod
    def _give_up(awaiting: dict[int, _Awaited], instance: int, second: float, noted: list[float]) -> None:
        awaited = awaiting.pop(instance, None)
        if awaited is None or awaited.since_s is None:
            return
        if second - awaited.since_s > TIME_TO_NOTICE_S:
            noted.append(inf)


def _note_shown(awaiting: dict[int, _Awaited], visible: Iterable[VisibleObject], second: float) -> None:
    for seen in visible:
        awaited = awaiting.get(seen.instance)
        if awaited is not None and _is_well(seen):
            awaited.shown.append(second)


def _is_well(seen: VisibleObject) -> bool:
    return seen.image_share >= WELL_SHARE and seen.visibility >= LEAST_VISIBILITY


def _is_at(awaited: _Awaited, found: Sequence[FoundObject]) -> bool:
    """Whether the model still has that object at the place that it has left."""
    before = awaited.change.before
    return before is not None and any(
        each.id == awaited.id and _apart(before, each.at) <= _reach(each.name) for each in found
    )


def _reach(name: str) -> float:
    return REACH_M.get(name, REACH_ELSE_M)


def _apart(one: Sequence[float], other: Sequence[float]) -> float:
    return float(np.linalg.norm(np.subtract(one, other)))


def _percentile(values: Sequence[float], share: float) -> float | None:
    """Return the least value that so large a share of them does not exceed; None where that is infinite."""
    if not values:
        return None
    value = sorted(values)[ceil(share * len(values)) - 1]
    return round(value, 2) if np.isfinite(value) else None


def _share(part: int, whole: int) -> float | None:
    return round(part / whole, 3) if whole else None
