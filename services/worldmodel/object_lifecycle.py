"""The objects that a model knows: how they come, are told, become one, and go; by which rules. Pure."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.world import ChangeKind
from services.worldmodel.classes import Classes
from services.worldmodel.events import Event, Gone
from services.worldmodel.evidence import Looks
from services.worldmodel.frames import Frames
from services.worldmodel.fusion import begin, fit, is_compound
from services.worldmodel.objects import Index, Objects, Place, Unconfirmed, places_of
from services.worldmodel.offsets import Localisation
from services.worldmodel.placement import Sightings
from services.worldmodel.solids import Merger, may_meet, merge, shifted


@dataclass(frozen=True, slots=True)
class Rules:
    """How a model decides.

    localisation: how far poses are off. most_objects: of the site. most_seen: sightings of a view that count. most_new:
    new objects that a robot may bring in a view. most_unconfirmed: of a robot. most_at_place: unconfirmed ones on a
    square metre. Log-odds: a new object has `first`; a sighting with a score of 1 brings `hit`, less from farther away
    than `sure_m`, down to the share `least_sure`; a look that should show an object and does not takes `miss`, one past
    its place takes `past`; no more than `most`. confirm, fewest_hits: log-odds and sightings from which on an object is
    confirmed. gone: log-odds below which it is gone. moved_m: how far an object must have moved to be told as moved.
    fit_every: sightings until an object's box is fitted again.
    """

    localisation: Localisation = field(default_factory=Localisation)
    most_objects: int = 100_000
    most_seen: int = 300
    most_new: int = 100
    most_unconfirmed: int = 2_000
    most_at_place: int = 32
    first: float = -1.0
    hit: float = 1.4
    confirm: float = 1.8
    fewest_hits: int = 3
    gone: float = -1.5
    miss: float = 1.2
    past: float = 2.0
    most: float = 4.0
    moved_m: float = 0.4
    fit_every: int = 4
    sure_m: float = 6.0
    least_sure: float = 0.3


Rows = NDArray[np.intp]
Floats = NDArray[np.float64]

NS: Final = 1_000_000_000
ALWAYS_FIT_UP_TO_HITS: Final = 8
"""Boxes of objects with more hits are not fitted at each sighting, but once in `Rules.fit_every`."""

HITS_TO_SETTLE: Final = 20
"""Objects of classes that do not move by themselves can be told as moved only after so many sightings."""

MOVING_M_S: Final = 0.2
"""An object that moves faster than this is placed where it was last seen."""

MIN_SEEN_SHARE: Final = 0.35
"""Misses alone discard only objects seen in a smaller share of the views that should show them."""

LOGIT_FLOOR_FOR_MISSES: Final = 0.5
"""Misses alone do not lower the log-odds of an object that is seen often below this."""

UNCONFIRMED_NS: Final = 60 * NS
MOST_ROWS: Final = 1 << 32
TOO_MANY: Final = "the site has its most objects"
FLOOD: Final = "more new objects than a robot may bring"
CROWDED: Final = "more new objects at one place than there may be"


class ObjectLifecycle:
    """A site's objects by row. left_out: counts by robot and reason, shared with the model. events: of this batch."""

    def __init__(self, rules: Rules, classes: Classes, left_out: Counter[tuple[str, str]]) -> None:
        self.objects = Objects.none()
        self.index = Index()
        self.next_number = 0
        self.events: list[Event] = []
        self._rules = rules
        self._classes = classes
        self._left_out = left_out
        self._merger = Merger()
        self._gone = Gone()
        self._unconfirmed = Unconfirmed()
        self._free = list(range(self.objects.capacity))[::-1]
        self._dropped: list[int] = []

    def begin(self) -> None:
        """Begin a batch: events of the last one have been told, and rows of objects dropped in it are free again."""
        self.events = []
        self._free += self._dropped
        self._dropped = []

    def restore(self, objects: Objects, next_number: int) -> None:
        """Go on with objects that were known before, where none is known."""
        self.objects, self.next_number = objects, next_number
        self._free = np.flatnonzero(objects.number < 0)[::-1].tolist()
        rows = objects.known()
        self.index.put(rows, objects.centre[rows])

    def keys(self, frame: Rows, rows: Rows) -> Rows:
        """Return numbers of pairs of views and rows."""
        return frame * MOST_ROWS + rows

    def create(self, frames: Frames, seen: Sightings, new: Rows, pose: Floats) -> tuple[Rows, Rows]:
        """Make new objects of sightings of nothing known; return of which, and their rows."""
        new = new[~is_compound(seen, self._classes)[new]]
        new, rows = self._allowed(frames, seen, new)
        alive = self.objects.number[rows] >= 0  # others of the same views made room
        new, rows = new[alive], rows[alive]
        if not len(new):
            return new, new
        objects, frame = self.objects, seen.frame[new]
        objects.clear(rows)
        begin(objects, rows, seen.taken(new), pose[new], self._classes)
        objects.anchor_robot[rows] = frames.robots[frame]
        objects.logit[rows] = self._rules.first + gain(self._rules, seen, new)
        objects.hits[rows] = 1
        for times in (objects.first_ns, objects.last_ns, objects.series_ns):
            times[rows] = frames.at_ns[frame]
        note_seers(objects, rows, frames.cameras[frame], frames.at_ns[frame])
        self.fit(rows)
        return new, rows

    def forget(self, robots: Iterable[str]) -> None:
        """Forget which objects robots brought."""
        self._unconfirmed.forget(robots)

    def _allowed(self, frames: Frames, seen: Sightings, new: Rows) -> tuple[Rows, Rows]:
        """Return the new objects that there is room for, and a row for each; the others are counted."""
        frame = seen.frame[new]
        nth = np.arange(len(new)) - np.searchsorted(frame, frame)
        kept, rows = [], []
        for each, robot, number, place in zip(
            new.tolist(),
            (frames.views[view].header.robot for view in frame.tolist()),
            nth.tolist(),
            places_of(seen.middle[new]),
            strict=True,
        ):
            why = FLOOD if number >= self._rules.most_new else self._refused(robot, place)
            if why:
                self._left_out[robot, why] += 1
            else:
                kept.append(each)
                rows.append(self._row())
                self._unconfirmed.add(rows[-1], robot, place)
        return np.array(kept, np.intp), np.array(rows, np.intp)

    def _refused(self, robot: str, place: Place) -> str:
        """Return why there is no room for a new object of a robot, or nothing.

        Where there would be none, the oldest unconfirmed one of the robot with most of them makes room: it is that one
        which fills the place, or the site.
        """
        unconfirmed, rules = self._unconfirmed, self._rules
        if unconfirmed.count(robot) >= rules.most_unconfirmed:
            return FLOOD
        if unconfirmed.count_at(place) >= rules.most_at_place and not self._make_room(
            unconfirmed.instead_at(place, robot), CROWDED
        ):
            return CROWDED
        used = self.objects.capacity - len(self._free) - len(self._dropped)
        if used >= rules.most_objects and not self._make_room(unconfirmed.instead(robot), FLOOD):
            return TOO_MANY
        return ""

    def _make_room(self, row: int | None, why: str) -> bool:
        if row is None:
            return False
        self._left_out[self._unconfirmed.robot(row), why] += 1
        self._drop(row)
        return True

    def _row(self) -> int:
        if not self._free:
            before = self.objects.capacity
            self.objects.grow()
            self._free = list(range(before, self.objects.capacity))[::-1]
        row = self._free.pop()
        self.objects.number[row] = self.next_number
        self.next_number += 1
        return row

    def fit(self, rows: Rows) -> None:
        """Fit the boxes of objects to what is known of them now."""
        if len(rows):
            fit(self.objects, rows, self._classes)
            self.index.put(rows, self.objects.centre[rows])

    def confirm(self, frames: Frames, frame: Rows, rows: Rows, looks: Looks, found: Rows) -> None:
        objects, rules = self.objects, self._rules
        rows, first = np.unique(rows, return_index=True)
        there = objects.number[rows] >= 0  # others made room for what is new
        rows, first = rows[there], first[there]
        if not len(rows):
            return
        frame_of = frame[first]
        due = (objects.fits[rows] >= rules.fit_every) | (objects.hits[rows] <= ALWAYS_FIT_UP_TO_HITS)
        due |= self._classes.moves[objects.cls[rows]]
        self.fit(rows[due])
        self._merge(frames, frame_of[due], rows[due], looks, found)
        there = (objects.number[rows] >= 0) & due
        rows, frame_of = rows[there], frame_of[there]
        ready = ~objects.confirmed[rows] & (objects.logit[rows] >= rules.confirm)
        ready &= objects.hits[rows] >= rules.fewest_hits
        far = objects.confirmed[rows] & self._is_elsewhere(rows) & self._is_settled(rows)
        for row, each, new in zip(
            rows[ready | far].tolist(), frame_of[ready | far].tolist(), ready[ready | far].tolist(), strict=True
        ):
            self._tell(ChangeKind.APPEARED if new else ChangeKind.MOVED, row, frames, each)

    def _is_elsewhere(self, rows: Rows) -> NDArray[np.bool_]:
        """Return which objects are farther than `moved_m` from where they were told to be.

        Of what does not move by itself its edges say so, too; of trucks, which are seen in parts, they do not.
        """
        objects, rules = self.objects, self._rules
        moves = np.hypot(*objects.velocity[rows].T) > MOVING_M_S
        away = np.hypot(*(objects.centre[rows] - objects.told[rows, :2]).T)
        far = shifted(objects.edges[rows], objects.told_edges[rows]) > rules.moved_m
        return np.asarray((far & ~self._classes.moves[objects.cls[rows]]) | (moves & (away > rules.moved_m)))

    def _is_settled(self, rows: Rows) -> NDArray[np.bool_]:
        """Return which objects can have moved; of what was seen a few times, only the estimate is better by now."""
        objects = self.objects
        settled = (objects.hits[rows] > HITS_TO_SETTLE) | self._classes.moves[objects.cls[rows]]
        young = rows[~settled]
        objects.told_edges[young] = objects.measured(young)
        found_now = np.isnan(objects.told_edges[rows])
        objects.told_edges[rows] = np.where(found_now, objects.measured(rows), objects.told_edges[rows])
        return np.asarray(settled)

    def _tell(self, kind: ChangeKind, row: int, frames: Frames, frame: int, into: int | None = None) -> None:
        objects, at_ns = self.objects, int(frames.at_ns[frame])
        x, y = objects.centre[row].tolist()
        at = x, y, float(objects.low[row] + objects.high[row]) / 2
        before = tuple(objects.told[row].tolist()) if kind is ChangeKind.MOVED else None
        if kind is ChangeKind.APPEARED:
            objects.confirmed[row] = True
            self._unconfirmed.drop(row)
            number = self._gone.take(int(objects.cls[row]), at, at_ns)
            if number is not None:
                kind, objects.number[row] = ChangeKind.BACK, number
        objects.told[row], objects.told_edges[row], objects.told_ns[row] = at, objects.measured([row])[0], at_ns
        robot = int(frames.robots[frame])
        number = int(objects.number[row])
        self.events.append(Event(kind, row, number, at_ns, robot, before, into))

    def _merge(self, frames: Frames, frame: Rows, rows: Rows, looks: Looks, found: Rows) -> None:
        objects = self.objects
        number, second = self.index.near(objects.centre[rows])
        first, frame = rows[number], frame[number]
        kept = np.flatnonzero((objects.cls[first] == objects.cls[second]) & (first != second))
        kept = kept[may_meet(objects, self._classes, first[kept], second[kept])]
        first, second, frame = first[kept], second[kept], frame[kept]
        keys = self.keys(frame, second)
        together = np.isin(keys, found)
        apart = np.isin(keys, self.keys(looks.frame, looks.rows)) & ~together
        for one, other in self._merger.doubles(objects, self._classes, first, second, together=together, apart=apart):
            if objects.number[one] >= 0 and objects.number[other] >= 0:
                kept_row, lost = merge(objects, self._classes, one, other)
                if objects.confirmed[lost]:
                    by = int(frame[(first == one) & (second == other)][0])
                    self._tell(ChangeKind.MERGED, lost, frames, by, int(objects.number[kept_row]))
                self._drop(lost)
                self.fit(np.array([kept_row], np.intp))

    def miss(self, frames: Frames, looks: Looks, found: Rows) -> None:
        """Hold looks that do not show an object against it."""
        objects, rules = self.objects, self._rules
        seen = np.isin(self.keys(looks.frame, looks.rows), found)
        late = frames.at_ns[looks.frame] > objects.last_ns[looks.rows]
        missed = looks.taken(~seen & late & (objects.number[looks.rows] >= 0))
        if not len(missed.rows):
            return
        rate = self._classes.rate(objects.cls[missed.rows], missed.distance)
        weak = rules.miss * rate / (1 + objects.hits[missed.rows] / 4)
        rows, at = np.unique(missed.rows, return_inverse=True)
        past = np.bincount(at, missed.past) > 0
        loss = np.bincount(at, np.where(missed.past, rules.past, weak))
        objects.looks[rows] += np.bincount(at, rate)
        np.maximum.at(objects.looked_ns, missed.rows, frames.at_ns[missed.frame])
        lasting = objects.confirmed[rows] & ~past & (objects.hits[rows] >= MIN_SEEN_SHARE * objects.looks[rows])
        least = np.where(lasting, np.minimum(objects.logit[rows], LOGIT_FLOOR_FOR_MISSES), -np.inf)
        objects.logit[rows] = np.maximum(objects.logit[rows] - loss, least)
        for row in rows[objects.logit[rows] < rules.gone].tolist():
            if objects.confirmed[row]:
                by = int(missed.frame[np.flatnonzero(missed.rows == row)[-1]])
                self._tell(ChangeKind.GONE, row, frames, by)
                at3 = tuple(objects.told[row].tolist())
                self._gone.add(int(objects.number[row]), int(objects.cls[row]), at3, int(frames.at_ns[by]))
            self._drop(row)

    def sweep(self, now_ns: int) -> None:
        """Forget what was not confirmed in a while, and where there is no room for classes, those without objects."""
        objects = self.objects
        rows = objects.known()
        for row in rows[~objects.confirmed[rows] & (objects.last_ns[rows] < now_ns - UNCONFIRMED_NS)].tolist():
            self._drop(row)
        if self._classes.is_short:
            used = {*objects.cls[objects.known()].tolist(), *self._gone.classes(now_ns)}
            self._classes.release(used, set(objects.cls[objects.told_to_others()].tolist()))

    def _drop(self, row: int) -> None:
        self.index.drop(row)
        self._unconfirmed.drop(row)
        self.objects.number[row] = -1
        self.objects.confirmed[row] = False
        self._dropped.append(row)  # what is told of it is made of the row


def gain(rules: Rules, seen: Sightings, which: Rows) -> Floats:
    """Return the log-odds that sightings bring; those from far away bring less."""
    return np.asarray(rules.hit * seen.score[which] * np.clip(rules.sure_m / seen.depth[which], rules.least_sure, 1))


def note_seers(objects: Objects, rows: Rows, cameras: Rows, at_ns: NDArray[np.int64]) -> None:
    """Note which camera saw each object."""
    same = objects.seers[rows] == cameras[:, np.newaxis]
    slot = np.where(same.any(axis=1), same.argmax(axis=1), objects.seers_ns[rows].argmin(axis=1))
    objects.seers[rows, slot], objects.seers_ns[rows, slot] = cameras, at_ns
