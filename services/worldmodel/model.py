"""A site's model: takes views in, knows the objects. Pure: time is an argument."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from itertools import count
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.distances import CameraView
from services.worldmodel.association import Assignment, assign, close, displaced, near, once_each
from services.worldmodel.class_names import NAMED_NS, Vocabulary
from services.worldmodel.classes import Classes
from services.worldmodel.events import Event
from services.worldmodel.evidence import FARTHEST_M, Looks, look
from services.worldmodel.floor_levels import floor_levels
from services.worldmodel.frames import Frames, rounds
from services.worldmodel.fusion import draw_to_poses, fuse, is_compound
from services.worldmodel.motion import drifts, move, moves
from services.worldmodel.name_limits import CameraName, NameNumbers
from services.worldmodel.object_lifecycle import ObjectLifecycle, Rules, gain, note_seers
from services.worldmodel.objects import Index, Objects
from services.worldmodel.offsets import RIGHT, Offsets
from services.worldmodel.placement import Sightings, place
from services.worldmodel.solids import covers_several

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Found = tuple[Assignment, Assignment]

NS: Final = 1_000_000_000
SETTLED: Final = 5
"""Sightings after which an object says where the robots are that see it."""

NEW_VIEWS: Final = 2.5
"""Cameras of one robot may see the same: a thing is new for so many times as long as one takes from view to view, and
no longer than so many seconds."""

KNOWN_M2: Final = 0.25
"""Variance from which on an object says nothing of where a robot is."""

SWEEP_NS: Final = 6 * NS
DOUBTED: Final = "of a robot whose pose is doubted"
UNLOCATED: Final = "of a robot without a map frame"
OTHER_NAME: Final = "another model's class names"
_MORE_CAMERAS: Final = 256


class SiteModel:
    """One site's objects. No content of views makes it raise; sightings left out are counted by robot and reason.

    Those of forgotten robots are counted without their names.

    identify: told, of each view, the numbers of the objects that its detections belong to, by their `index`.
    """

    def __init__(
        self,
        rules: Rules | None = None,
        classes: Classes | None = None,
        identify: Callable[[CameraView, Mapping[int, int]], None] | None = None,
    ) -> None:
        self.rules = rules or Rules()
        self.classes = classes or Classes()
        self.offsets = Offsets(self.rules.localisation)
        self.robots = NameNumbers("")
        self.cameras = NameNumbers(("", ""))
        self.left_out: Counter[tuple[str, str]] = Counter()
        self._identify = identify
        self.views = 0
        self.sightings = 0
        self.lifecycle = ObjectLifecycle(self.rules, self.classes, self.left_out)
        self.vocabulary = Vocabulary()
        self._robot_of = np.full(0, -1, np.int64)
        self._swept_ns = 0

    def take(self, view: CameraView, at_ns: int) -> list[Event]:
        """Take in a view that was taken at `at_ns`, and return what changed."""
        return self.take_all([(view, at_ns)])

    def take_all(self, views: Sequence[tuple[CameraView, int]]) -> list[Event]:
        """Take in views, in the order in which they were taken, and return what changed."""
        self.lifecycle.begin()
        self.views += len(views)
        located = []
        for view, at_ns in views:
            if view.position is None:
                self.left_out[view.header.robot, UNLOCATED] += sum(view.unmeasured.values())
            else:
                located.append((view, at_ns))
        for some in rounds(located):
            self._round(self._frames(some))
        if views and views[-1][1] - self._swept_ns > SWEEP_NS:
            self._swept_ns = views[-1][1]
            self.lifecycle.sweep(self._swept_ns)
        return self.lifecycle.events

    def restore(
        self, objects: Objects, classes: Sequence[str], cameras: Sequence[tuple[str, str]], next_number: int
    ) -> None:
        """Go on with objects that were known before, in a model that knows none."""
        for name in classes:
            self.classes.number(name)
        self.cameras.restore(cameras)
        self._robot_of = np.array([self.robots.number(robot) if robot else -1 for robot, _ in cameras], np.int64)
        self.offsets.reserve(len(self.robots.names))
        self.lifecycle.restore(objects, next_number)

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now: the clock was set back, and what is seen from now on is newer than what was."""
        self.objects.set_back(now_ns)
        self.offsets.set_back(now_ns)
        self.vocabulary.set_back(now_ns)
        self._swept_ns = min(self._swept_ns, now_ns)

    def forget(self, robots: Collection[str], cameras: Collection[CameraName]) -> None:
        """Forget robots and cameras: their numbers are for others from now on. The objects that they saw stay."""
        robot_numbers, camera_numbers = (
            np.array(each, np.intp) for each in (self.robots.forget(robots), self.cameras.forget(cameras))
        )
        self.offsets.forget(robot_numbers, camera_numbers)
        self.lifecycle.forget(robots)
        self.classes.forget(robots)
        self.objects.forget_seers(robot_numbers, camera_numbers)
        self._robot_of[camera_numbers[camera_numbers < len(self._robot_of)]] = -1
        for robot, reason in [each for each in self.left_out if each[0] in robots]:
            self.left_out["", reason] += self.left_out.pop((robot, reason))

    def trusts(self, robot: str) -> bool:
        """Return whether a robot that sent views is where it says, as far as one knows."""
        number = self.robots.find(robot)
        return number is not None and bool(self.offsets.doubted[number] == RIGHT)

    @property
    def objects(self) -> Objects:
        """The objects by row."""
        return self.lifecycle.objects

    @property
    def index(self) -> Index:
        """Which rows are near a place."""
        return self.lifecycle.index

    def _frames(self, views: Sequence[tuple[CameraView, int]]) -> Frames:
        headers = [view.header for view, _ in views]
        cameras = [self.cameras.number((each.robot, each.camera)) for each in headers]
        robots = [self.robots.number(each.robot) for each in headers]
        self.offsets.reserve(len(self.robots.names))  # even where a view fails below, its robot has a number
        more = len(self.cameras.names) - len(self._robot_of)
        if more > 0:
            self._robot_of = np.concatenate([self._robot_of, np.full(more + _MORE_CAMERAS, -1)])
        self._robot_of[cameras] = robots
        return Frames.of([view for view, _ in views], [at_ns for _, at_ns in views], robots, cameras)

    def _round(self, frames: Frames) -> None:
        objects, offsets = self.objects, self.offsets
        offsets.reserve(len(self.robots.names))
        offsets.predict(frames.robots, frames.cameras, frames.at_ns, frames.camera)
        state = offsets.state[frames.robots]
        camera, rotation = frames.moved(state)
        seen = self._placed(frames)
        seen.shift(state)
        around = self.index.near(seen.middle)
        row, of = close(seen, objects, *around)
        pose = offsets.pose_covariance(frames.robots[seen.frame], seen.away)
        found = assign(seen, objects, row, of, pose)
        named, since_ns = self.vocabulary.heed(frames, seen, self.classes.names)
        found, renamed = self._under_other_names(seen, found, around, named, pose=pose)
        looks = look(frames, camera, rotation, objects, self.index)
        floor_m = floor_levels(frames, camera, rotation)
        sane = self._judge(frames, seen, (found, renamed), looks, named=named, floor_m=floor_m)
        trusted = offsets.doubted[frames.robots] == RIGHT
        found, looks = self._trusted(frames, seen, found, looks, trusted)
        spared = self._spared(frames, looks, sane)
        sure = self._settled(of)
        several = covers_several(seen, objects, row[sure], of[sure], rotation[seen.frame, :2, 0])
        moved = moves(
            seen, objects, self.classes, found, looks=looks.not_past(spared), pairs=around, at_ns=frames.at_ns
        )
        for each in (moved, drifts(seen, objects, self.classes, found)):
            move(objects, each, (frames.at_ns[seen.frame[each.seen]] - objects.last_ns[each.of]) / NS)
            self.index.put(each.of, objects.centre[each.of])
        new = np.setdiff1d(found.new, moved.seen, assume_unique=True)
        which, rows = np.concatenate([found.seen, moved.seen]), np.concatenate([found.of, moved.of])
        for some in once_each(rows):
            self._update(frames, seen, (which[some], rows[some]), pose=pose, several=several)
        keys = self.lifecycle.keys(seen.frame[which], rows)
        created = self.lifecycle.create(frames, seen, new, pose)
        if self._identify is not None:
            self._tell(self._identify, frames, seen.nth[np.append(which, created[0])], np.append(rows, created[1]))
        self.lifecycle.confirm(frames, seen.frame[which], rows, looks, keys)
        self._rename(frames, seen, renamed, since_ns)
        held = ~spared & (looks.past | named[looks.frame, objects.cls[looks.rows]])
        self.lifecycle.miss(frames, looks.taken(held), keys)

    def _tell(
        self, identify: Callable[[CameraView, Mapping[int, int]], None], frames: Frames, nth: Rows, rows: Rows
    ) -> None:
        number_of = dict(zip(nth.tolist(), self.objects.number[rows].tolist(), strict=True))
        nths = count()
        for view in frames.views:
            pairs = [(each.index, number_of.get(next(nths), -1)) for each in view.objects]
            identify(view, {index: number for index, number in pairs if number >= 0})

    def _placed(self, frames: Frames) -> Sightings:
        seen, left_out = place(frames, self.classes, self.rules.most_seen)
        self.sightings += len(seen)
        self.left_out.update(left_out)
        return seen

    def _settled(self, rows: Rows) -> Bools:
        return np.asarray(self.objects.confirmed[rows] & (self.objects.hits[rows] >= SETTLED))

    def _under_other_names(
        self, seen: Sightings, found: Assignment, around: tuple[Rows, Rows], named: Bools, *, pose: Floats
    ) -> tuple[Assignment, Assignment]:
        """Split off what of the new is known, of a class that the view's model does not give."""
        objects, moves = self.objects, self.classes.moves
        row, of = around
        kept = np.isin(row, found.new) & self._settled(of) & ~named[seen.frame[row], objects.cls[of]]
        kept &= ~moves[objects.cls[of]] & ~moves[seen.classes[row]]
        renamed = assign(seen, objects, *near(seen, objects, row[kept], of[kept]), pose)
        return replace(found, new=np.setdiff1d(found.new, renamed.seen, assume_unique=True)), renamed

    def _judge(
        self, frames: Frames, seen: Sightings, found: Found, looks: Looks, *, named: Bools, floor_m: Floats
    ) -> Bools:
        """Compare views with what is known; return which views' depth may be right. found: by name, and by place."""
        objects, keys, count = self.objects, self.lifecycle.keys, len(frames)
        looks = looks.taken(self._settled(looks.rows) & ~self.classes.moves[objects.cls[looks.rows]])
        met, by_place = (np.isin(keys(looks.frame, looks.rows), keys(seen.frame[of.seen], of.of)) for of in found)
        by_name = named[looks.frame, objects.cls[looks.rows]]
        expected, there = by_name | by_place | looks.past, met | by_place
        others = self._seen_by_others(frames, looks)
        sane = self.offsets.judge(
            frames.robots,
            np.bincount(looks.frame[expected], minlength=count),
            np.bincount(looks.frame[there], minlength=count),
            looked_past=np.bincount(looks.frame[looks.past & ~there], minlength=count),
            strange=np.bincount(seen.frame[self._strange(frames, seen, found)], minlength=count),
            seen_by_others=np.bincount(looks.frame[expected & ~there & others], minlength=count),
            floor_m=floor_m,
        )
        counted = by_name & (self.offsets.doubted[frames.robots] == RIGHT)[looks.frame]
        self.classes.learn(objects.cls[looks.rows[counted]], looks.distance[counted], met[counted])
        return sane

    def _strange(self, frames: Frames, seen: Sightings, found: Found) -> Bools:
        """Return which sightings may be of known things that are elsewhere: of none that three views showed there."""
        objects, classes, frame = self.objects, self.classes, seen.frame
        strange = ~classes.moves[seen.classes] & (seen.depth < FARTHEST_M) & ~is_compound(seen, classes)
        late_ns = frames.at_ns - NEW_VIEWS * np.minimum(self.offsets.interval_ns[frames.robots], NS)
        for each in found:
            few = objects.hits[each.of] < self.rules.fewest_hits
            strange[each.seen] &= few | (objects.first_ns[each.of] > late_ns[frame[each.seen]])
        return strange

    def _spared(self, frames: Frames, looks: Looks, sane: Bools) -> Bools:
        """Return which looks remove nothing: of wrong depth, or of unsure robots at objects that another robot saw."""
        spared = self.objects.confirmed[looks.rows] & self._seen_by_others(frames, looks)
        return np.asarray(~sane[looks.frame] | (spared & ~self.offsets.sure[frames.robots[looks.frame]]))

    def _seen_by_others(self, frames: Frames, looks: Looks) -> Bools:
        """Return which looks are at objects that another robot saw, or one that is forgotten."""
        seers, robots = self.objects.seers[looks.rows], frames.robots[looks.frame]
        by_others = (seers >= 0) & (self._robot_of[seers] != robots[:, np.newaxis])
        return np.asarray(by_others.any(axis=1) | (seers < 0).all(axis=1))

    def _rename(self, frames: Frames, seen: Sightings, found: Assignment, since_ns: NDArray[np.int64]) -> None:
        """Note that things are there that have another name; they take it if nobody calls them by theirs for long."""
        objects, frame = self.objects, seen.frame[found.seen]
        kept = (self.offsets.doubted[frames.robots[frame]] == RIGHT) & (objects.number[found.of] >= 0)
        rows, frame, which = found.of[kept], frame[kept], found.seen[kept]
        for each in frame.tolist():
            self.left_out[frames.views[each].header.robot, OTHER_NAME] += 1
        at_ns = frames.at_ns[frame]
        np.maximum.at(objects.last_ns, rows, at_ns)
        note_seers(objects, rows, frames.cameras[frame], at_ns)
        late = at_ns - np.maximum(objects.series_ns[rows], since_ns[frame]) > NAMED_NS
        objects.cls[rows[late]] = seen.classes[which[late]]

    def _trusted(
        self, frames: Frames, seen: Sightings, found: Assignment, looks: Looks, trusted: Bools
    ) -> tuple[Assignment, Looks]:
        if trusted.all():
            return found, looks
        for each in np.flatnonzero(~trusted).tolist():
            self.left_out[frames.views[each].header.robot, DOUBTED] += int((seen.frame == each).sum())
        kept, new = trusted[seen.frame[found.seen]], found.new[trusted[seen.frame[found.new]]]
        return (
            Assignment(found.seen[kept], found.of[kept], found.moved[kept], new),
            looks.taken(trusted[looks.frame]),
        )

    def _update(
        self, frames: Frames, seen: Sightings, pairs: tuple[Rows, Rows], *, pose: Floats, several: Bools
    ) -> None:
        """Take in sightings of objects, each object once."""
        objects, rules, (which, rows) = self.objects, self.rules, pairs
        frame = seen.frame[which]
        robots, at_ns = frames.robots[frame], frames.at_ns[frame]
        self._begin_series(rows, robots, at_ns)
        self._correct(seen, which, rows, robots)
        passed = np.maximum((at_ns - objects.series_ns[rows]) / NS, 0.1)
        again = objects.hits[rows] > 1
        repeats = np.where(again, rules.localisation.seconds / passed, 1.0)
        single = ~several[which] | self.classes.is_large(objects.cls[rows])
        some, of = which[single], rows[single]
        fuse(objects, self.classes, of, seen.taken(some), pose=pose[some], repeats=repeats[single])
        draw_to_poses(
            objects,
            rows,
            offsets=self.offsets.state[robots],
            away=seen.away[which],
            at_ns=at_ns,
            seconds=rules.localisation.seconds,
        )
        objects.series_ns[rows] = at_ns
        objects.logit[rows] = np.minimum(objects.logit[rows] + gain(rules, seen, which), rules.most)
        objects.hits[rows] += 1
        objects.fits[rows] += 1
        objects.last_ns[rows] = np.maximum(objects.last_ns[rows], at_ns)
        objects.velocity[rows] *= np.where(np.abs(objects.velocity[rows]) < 0.05, 0.0, 0.9)
        note_seers(objects, rows, frames.cameras[frame], at_ns)

    def _begin_series(self, rows: Rows, robots: Rows, at_ns: NDArray[np.int64]) -> None:
        objects = self.objects
        late = at_ns - objects.series_ns[rows] > self.rules.localisation.seconds * NS / 2
        other = (objects.anchor_robot[rows] != robots) | late
        new = rows[other]
        objects.anchor[new], objects.anchor_variance[new] = objects.edges[new], objects.variance[new]
        objects.anchor_robot[new] = robots[other]

    def _correct(self, seen: Sightings, which: Rows, rows: Rows, robots: Rows) -> None:
        """Let what stands still, as it was known before the robot saw it, say how far the robot's pose is off."""
        objects = self.objects
        still = objects.confirmed[rows] & ~self.classes.moves[objects.cls[rows]]
        which, rows, robots = which[still], rows[still], robots[still]
        moved, covariance = displaced(
            seen.edges[which], seen.noise[which], objects.anchor[rows], objects.anchor_variance[rows]
        )
        known = (covariance[:, 0] < KNOWN_M2) & (covariance[:, 2] < KNOWN_M2)
        self.offsets.correct(robots[known], seen.away[which[known]], moved[known], covariance[known])
