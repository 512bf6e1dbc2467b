"""Buffers transforms from /tf and /tf_static, and looks them up at a sensor's stamp."""

import math
from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.header import Header
from schemas.space import MAX_COORDINATE_M
from schemas.transforms import Transform, Transforms
from services.geometry.errors import (
    LoopError,
    SilentError,
    TooNewError,
    TooOldError,
    TransformError,
    UnconnectedError,
    UnknownFrameError,
)
from services.geometry.memory_budget import CROWDED, MemoryBudget
from services.geometry.rotation import inverse_of, matrix_of, slerp

Numbers = NDArray[np.float64]

KEEP_NS: Final = 10_000_000_000
JUMP_NS: Final = 1_000_000_000
"""Stamps of one frame that go back by more than this are of a clock that jumped: its kept transforms are dropped."""

SILENT_NS: Final = 1_000_000_000
"""A transform that is still published arrives at shorter intervals than this."""

MAX_SAMPLES: Final = 5_000
MOST_SAMPLES: Final = 200_000
"""Limits per frame, and of all frames, which have equal shares of it."""

SAMPLE_BYTES: Final = 400
"""The approximate size of one of them."""

MAX_FRAMES: Final = 4_096
_UNIT: Final = 0.01

BAD_ROTATION: Final = "a rotation that is not of length 1"
NOT_FINITE: Final = "not finite"
TOO_FAR: Final = "farther away than any place"
OF_ITSELF: Final = "a frame seen from itself"
OUTDATED: Final = "static, of a frame that has moved since"
NAMELESS: Final = "a frame without a name"
TOO_MANY: Final = "too many frames"


@dataclass(slots=True)
class _Moving:
    """A frame's transforms to its parent, ascending by stamp; never empty.

    began_ns: the first stamp, also of those that are not kept any more.
    """

    parent: str
    began_ns: int
    stamps: list[int] = field(default_factory=list)
    poses: list[tuple[Numbers, Numbers]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Static:
    """A frame's static transform to its parent, as a 4 x 4 matrix. stamp_ns: when it was published."""

    parent: str
    stamp_ns: int
    matrix: Numbers


class TransformTree:
    """One robot's frames of reference. A frame has one parent, the one published last, as in ROS.

    Static transforms are sent again whenever one is added. Of a frame that is said to be static and to move, the moving
    transforms count, whatever arrives first, but for stamps at which it does not move yet, and if the static one is
    newer than all of them, for those at which it moves no more (see SILENT_NS). So a moving one that is stamped far in
    the future takes no static frame away.

    keep_ns: how far back transforms are kept. budget: what it may share with others. rejected: transforms that were not
    taken, or gave way to something else, by reason.
    """

    def __init__(self, keep_ns: int = KEEP_NS, budget: MemoryBudget | None = None) -> None:
        self._keep_ns = keep_ns
        self._budget = budget or MemoryBudget()
        self._samples = 0
        self._moving: dict[str, _Moving] = {}
        self._static: dict[str, _Static] = {}
        self.rejected: Counter[str] = Counter()

    def take(self, transforms: Transforms, *, static: bool) -> None:
        """Add transforms from `tf`, or if `static`, from `tf_static`."""
        for transform in transforms.transforms:
            self.add(transform, static=static)
        self._budget.hold(self, self._samples * SAMPLE_BYTES)
        self._budget.settle()

    def add(self, transform: Transform, *, static: bool) -> None:
        """Add one transform; invalid ones are counted in `rejected`."""
        parent, child = frame_name(transform.frame_id), frame_name(transform.child_frame_id)
        reason = _fault(parent, child, transform)
        if reason is None and self._is_one_too_many(child):
            reason = TOO_MANY
        if reason is None and static and self._has_moved(child, transform.stamp_ns):
            reason = OUTDATED
        if reason is not None:
            self.rejected[reason] += 1
            return
        translation = np.array(transform.translation, np.float64)
        rotation = np.array(transform.rotation, np.float64)
        rotation /= np.linalg.norm(rotation)
        if static:
            self._static[child] = _Static(parent, transform.stamp_ns, matrix_of(translation, rotation))
        else:
            self._move(child, parent, transform.stamp_ns, (translation, rotation))

    def flush(self) -> None:
        """Forget all transforms that are not static: the clock has changed."""
        self._moving.clear()
        self._samples = 0
        self._budget.hold(self, 0)

    def shed(self) -> None:
        """Drop the older half of the moving transforms; a frame without any left becomes unknown."""
        before = self._samples
        for moving in self._moving.values():
            self._forget(moving, (len(moving.stamps) + 1) // 2)
        self._moving = {child: moving for child, moving in self._moving.items() if moving.stamps}
        self.rejected[CROWDED] += before - self._samples
        self._budget.hold(self, self._samples * SAMPLE_BYTES)

    def lookup(self, target: str, source: str, stamp_ns: int) -> Numbers:
        """Return the 4 x 4 transform that moves points of the source frame into the target frame at a stamp.

        Between two stamps it is interpolated, beyond them it is not known. A frame is where it is itself, whatever is
        known of it.

        Raises:
            TransformError: why it is not known; the subclasses tell apart what may become known.
        """
        target, source = frame_name(target), frame_name(source)
        if target == source:
            return np.identity(4)
        for name in (target, source):
            self._check_known(name)
        (ups, looping), (downs, looping_too) = self._ancestry(source, stamp_ns), self._ancestry(target, stamp_ns)
        met = next((name for name in ups if name in downs), None)
        loop = looping or looping_too
        if loop and (met is None or met in loop):
            raise LoopError(f"frame {loop[0][:80]!r} is its own ancestor")
        if met is None:
            raise UnconnectedError(f"no transform leads from {source[:80]} to {target[:80]}")
        here = self._climb(ups[: ups.index(met)], stamp_ns)
        return here if met == target else inverse_of(self._climb(downs[: downs.index(met)], stamp_ns)) @ here

    def _check_known(self, name: str) -> None:
        said = (self._moving, self._static)
        if not any(name in each or any(edge.parent == name for edge in each.values()) for each in said):
            raise UnknownFrameError(f"nothing is known of frame {name[:80]!r}")

    def _is_one_too_many(self, child: str) -> bool:
        known = child in self._moving or child in self._static
        return not known and len(self._moving) + len(self._static) >= MAX_FRAMES

    def _edge(self, child: str, stamp_ns: int) -> _Moving | _Static | None:
        """Return the transforms from a frame to its parent that apply at a stamp."""
        moving, static = self._moving.get(child), self._static.get(child)
        if moving is None:
            return static
        last_ns = moving.stamps[-1]
        before = stamp_ns < moving.began_ns - SILENT_NS
        after = static is not None and static.stamp_ns > last_ns and stamp_ns > last_ns + SILENT_NS
        return static if static is not None and (before or after) else moving

    def _ancestry(self, name: str, stamp_ns: int) -> tuple[list[str], list[str]]:
        """Return a frame with all its ancestors, and the frames that are their own ancestors."""
        found = {name: None}
        while (edge := self._edge(name, stamp_ns)) is not None:
            name = edge.parent
            if name in found:
                names = list(found)
                return names, names[names.index(name) :]
            found[name] = None
        return list(found), []

    def _climb(self, names: list[str], stamp_ns: int) -> Numbers:
        """Return the transform from the first of the frames to the parent of the last."""
        made = np.identity(4)
        for name in names:
            match self._edge(name, stamp_ns):
                case _Static(matrix=matrix):
                    made = matrix @ made
                case _Moving() as moving:
                    made = _at(name, moving, stamp_ns) @ made
        return made

    def _has_moved(self, child: str, stamp_ns: int) -> bool:
        """Return whether a frame that moves did so at a stamp, or is known to have been static after it."""
        moving, static = self._moving.get(child), self._static.get(child)
        if moving is None or stamp_ns > moving.stamps[-1]:
            return False
        return stamp_ns >= moving.began_ns - SILENT_NS or (static is not None and static.stamp_ns > stamp_ns)

    def _move(self, child: str, parent: str, stamp_ns: int, pose: tuple[Numbers, Numbers]) -> None:
        moving = self._moving.get(child)
        if moving is None or moving.parent != parent:
            self._samples -= len(moving.stamps) if moving else 0
            moving = self._moving[child] = _Moving(parent, stamp_ns)
        self._insert(moving, stamp_ns, pose)

    def _insert(self, moving: _Moving, stamp_ns: int, pose: tuple[Numbers, Numbers]) -> None:
        newest = moving.stamps[-1] if moving.stamps else stamp_ns
        if stamp_ns < newest - JUMP_NS:
            self._forget(moving, len(moving.stamps))
            moving.began_ns = stamp_ns
        moving.began_ns = min(moving.began_ns, stamp_ns)
        place = bisect_left(moving.stamps, stamp_ns)
        known = place < len(moving.stamps) and moving.stamps[place] == stamp_ns
        moving.stamps[place : place + known] = [stamp_ns]
        moving.poses[place : place + known] = [pose]
        self._samples += not known
        self._trim(moving)

    def _trim(self, moving: _Moving) -> None:
        old = bisect_left(moving.stamps, moving.stamps[-1] - self._keep_ns)
        share = min(MAX_SAMPLES, MOST_SAMPLES // len(self._moving))
        self._forget(moving, max(old, len(moving.stamps) - share))

    def _forget(self, moving: _Moving, count: int) -> None:
        """Drop the oldest transforms."""
        if count > 0:
            del moving.stamps[:count], moving.poses[:count]
            self._samples -= count


def frame_name(frame_id: str) -> str:
    """Return a frame's name without the leading slash of old ROS versions."""
    return frame_id.removeprefix("/")


def _fault(parent: str, child: str, transform: Transform) -> str | None:
    """Return why a transform is invalid, or an empty string."""
    if not (parent and child):
        return NAMELESS
    if parent == child:
        return OF_ITSELF
    if not all(map(math.isfinite, (*transform.translation, *transform.rotation))):
        return NOT_FINITE
    if max(map(abs, transform.translation)) > MAX_COORDINATE_M:
        return TOO_FAR
    return BAD_ROTATION if abs(math.hypot(*transform.rotation) - 1) > _UNIT else None


def _at(child: str, edge: _Moving, stamp_ns: int) -> Numbers:
    """Return the transform from a moving frame to its parent at a stamp.

    Raises:
        TooOldError: the stamp is before the first that is kept.
        TooNewError: the stamp is after the last.
        SilentError: it is so by more than SILENT_NS.
    """
    place = bisect_left(edge.stamps, stamp_ns)
    if place == len(edge.stamps):
        late_ns = stamp_ns - edge.stamps[-1]
        error = TooNewError if late_ns <= SILENT_NS else SilentError
        raise error(f"{_between(child, edge)} is known until {late_ns / 1e9:.3f} s before the stamp")
    if edge.stamps[place] == stamp_ns:
        return matrix_of(*edge.poses[place])
    if place == 0:
        early_s = (edge.stamps[0] - stamp_ns) / 1e9
        raise TooOldError(f"{_between(child, edge)} is known from {early_s:.3f} s after the stamp")
    before, after = edge.stamps[place - 1], edge.stamps[place]
    share = (stamp_ns - before) / (after - before)
    (start, turned), (end, turning) = edge.poses[place - 1], edge.poses[place]
    return matrix_of(start + share * (end - start), slerp(turned, turning, share))


def _between(child: str, edge: _Moving) -> str:
    return f"the transform from {child[:80]} to {edge.parent[:80]}"


FIXED_FRAMES: Final = ("odom", "map")
"""Frames that stand still, the preferred one first: through them points of one instant are seen at another.

By REP 105 of ROS a robot moves without leaps in odom alone: in map it leaps whenever it is found to be elsewhere.
"""


LITTLE: Final = 2e-3
"""Metres and radians that are no movement: depth itself errs by more, and a pixel is about as wide."""


def between(target: Header, source: Header, tree: TransformTree) -> NDArray[np.float64]:
    """Return the 4 x 4 transform that moves points of one message's frame and stamp into those of another.

    Where no frame that stands still is known at both stamps, nothing is taken to have moved in between.

    Raises:
        TransformError: the one frame is not known from the other.
    """
    moving = _through_fixed(target, source, tree) if target.stamp_ns != source.stamp_ns else None
    try:
        at_rest = tree.lookup(target.frame_id, source.frame_id, source.stamp_ns)
    except TransformError:
        if moving is None:
            raise
        return moving
    return at_rest if moving is None or np.abs(moving - at_rest).max() < LITTLE else moving


def _through_fixed(target: Header, source: Header, tree: TransformTree) -> NDArray[np.float64] | None:
    """Return the transform through a frame known at both stamps; None if there is none."""
    for fixed in FIXED_FRAMES:
        try:
            there = tree.lookup(fixed, target.frame_id, target.stamp_ns)
            return np.asarray(inverse_of(there) @ tree.lookup(fixed, source.frame_id, source.stamp_ns))
        except TransformError:
            continue
    return None
