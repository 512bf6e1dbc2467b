"""How far each robot's localisation is off, estimated from what was seen before; lost robots are doubted. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.worldmodel.floor_levels import FloorLevels

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Whole = NDArray[np.int64]

NS: Final = 1e9


@dataclass(frozen=True, slots=True)
class Localisation:
    """How far poses are off, usually: 1 sigma in metres and radians, and seconds until an error is another one."""

    metres: float = 0.07
    radians: float = 0.02
    seconds: float = 30.0

    @property
    def variance(self) -> Floats:
        """Of x, y and yaw."""
        return np.array([self.metres**2, self.metres**2, self.radians**2])


SYSTEMATIC: Final = np.square([0.0075, 0.0075, 0.0015])
"""Variance of what things of a view have in common, however many they are: x, y, yaw."""

REPEATED: Final = 0.2
"""Views are taken to be so independent of each other, by the time that errors take to become others."""

OUTLIER: Final = 3.0
"""Mahalanobis distance, squared, from which on a thing pulls no more than this."""

JUMP_M_S: Final = 4.0
"""Robots do not drive faster: a pose that does has jumped."""

JUMP_M: Final = 0.5
TRUST_VIEWS: Final = 3
"""Fitting views before a doubted robot is trusted again. As many contradicting views make it doubted: fewer than remove
a well-known object, so a lost robot is doubted first."""

ALONE_VIEWS_TO_TRUST: Final = 30
"""Views before a robot is trusted again after a jump into unknown territory, where no known object can confirm it."""

OBJECTS_COUNTED_PER_VIEW: Final = 3
"""Most objects of a view that change trust, by TRUST_PER_OBJECT each: of a fitting view the found ones, of others those
that it should show, or, where no other robot saw the missed ones, these."""

TRUST_PER_OBJECT: Final = ALONE_VIEWS_TO_TRUST // OBJECTS_COUNTED_PER_VIEW
MOST_TRUST: Final = TRUST_VIEWS * ALONE_VIEWS_TO_TRUST
FIRST_TRUST: Final = ALONE_VIEWS_TO_TRUST
"""Trust in an unsure robot: none of its views has fitted yet, or none lately."""

PENALTY_PER_NEW_OBJECT: Final = 5
MOST_NEW_OBJECTS_COUNTED: Final = 2
"""Trust that an unsure robot loses for each unknown object in a contradicting view, and how many of them count. Three
views of two objects use up its trust before these are confirmed; a single object may be new, and is known soon."""

MIN_FOUND_SHARE: Final = 0.34
"""A view fits if it finds at least this share of the objects that it should show."""

MIN_NEW_PER_MISSED: Final = 0.34
"""A view contradicts if it shows at least so many new objects for each known one that it misses."""

MIN_EMPTIED_SHARE: Final = 0.5
"""A view shows an emptied place if it looks past this share of the missed objects; others may be there, undetected."""

TRUST_PER_EMPTIED_VIEW: Final = 12
"""Trust that a robot gains by each view of an emptied place: an unsure one needs five of them."""

CHANGED_VIEWS: Final = 100
"""If so many views contradict, and no robot is trusted anew meanwhile, the site has changed and nobody is lost."""

MOVED_M: Final = 1.0
BETWEEN_CAMERAS_M: Final = 3.0
"""How far a robot must have driven, more than its pose wavers, for its view to count as another one of those, or of a
place that is empty; and how much farther apart views of two of its cameras must be."""

RIGHT, LOST, JUMPED, WRONG_DEPTH = 0, 1, 2, 3
REASONS: Final = (
    "",
    "its pose does not fit what was seen before",
    "its pose has jumped",
    "its depth does not fit the floor",
)
_FIRST: Final = 16


class Offsets:
    """The offsets of a site's robots: mean-reverting random walks, so that the map as a whole cannot drift away.

    state: (robots, 3) x, y, yaw to add to poses. covariance: of it. doubted: RIGHT, LOST, JUMPED or WRONG_DEPTH. sure:
    what it saw fits, and did so lately. views: how many of each came. at_ns: when the last one was taken. position:
    (robots, 3) of the camera that took it. interval_ns: how long before it that camera took one. floors: how high the
    floor is that the cameras show.
    """

    def __init__(self, usual: Localisation) -> None:
        self.usual = usual
        self.state = np.zeros((0, 3))
        self.covariance = np.zeros((0, 3, 3))
        self.position = np.zeros((0, 3))
        self.at_ns = np.zeros(0, np.int64)
        self.doubted = np.zeros(0, np.int64)
        self.views = np.zeros(0, np.int64)
        self._passed = np.zeros(0)
        self._cameras = _LastPoses()
        self.sure = np.zeros(0, np.bool_)
        self._trust = np.zeros(0, np.int64)
        self._gained_ns = np.zeros(0, np.int64)
        self._wrong_ns = np.zeros(0, np.int64)
        self.interval_ns = np.zeros(0, np.int64)
        self._contradicted = 0
        self.floors = FloorLevels()
        self._camera = np.zeros(0, np.intp)
        self._counted = np.zeros((0, 3))
        self._counted_by = np.zeros(0, np.intp)

    def reserve(self, count: int) -> None:
        """Make room for so many robots."""
        more = count - len(self.state)
        if more <= 0:
            return
        more = max(more, _FIRST)
        start = np.broadcast_to(np.diag(self.usual.variance), (more, 3, 3))
        self.covariance = np.concatenate([self.covariance, start])
        self.state, self.position = (np.concatenate([a, np.zeros((more, 3))]) for a in (self.state, self.position))
        self._passed = np.concatenate([self._passed, np.zeros(more)])
        self.sure = np.concatenate([self.sure, np.zeros(more, np.bool_)])
        for name in ("at_ns", "doubted", "views", "_gained_ns", "_wrong_ns", "interval_ns", "_camera", "_counted_by"):
            setattr(self, name, np.concatenate([getattr(self, name), np.zeros(more, np.int64)]))
        self._trust = np.concatenate([self._trust, np.full(more, FIRST_TRUST)])
        self._counted = np.concatenate([self._counted, np.full((more, 3), np.inf)])

    def restore(self, robots: Sequence[int], doubted: Sequence[int]) -> None:
        """Go on doubting robots, where none is known. doubted: why."""
        for robot, why in zip(robots, doubted, strict=True):
            self.reserve(robot + 1)
            self._forget(np.array([robot]), why if why in (LOST, JUMPED, WRONG_DEPTH) else LOST)

    def predict(self, robots: Rows, cameras: Rows, at_ns: NDArray[np.int64], position: Floats) -> None:
        """Go on to views' instants; position: of their cameras. A jump of the pose begins anew, in doubt."""
        known = self.at_ns[robots] > 0
        passed = np.where(known, np.maximum(at_ns - self.at_ns[robots], 0) / NS, 0.0)
        jumped, self.interval_ns[robots] = self._cameras.move(cameras, at_ns, position)
        self._camera[robots] = cameras
        self._forget(robots[jumped], JUMPED)
        keep = np.exp(-passed / self.usual.seconds)
        self.state[robots] *= keep[:, np.newaxis]
        fresh = np.diag(self.usual.variance) * (1 - keep**2)[:, np.newaxis, np.newaxis]
        self.covariance[robots] = self.covariance[robots] * (keep**2)[:, np.newaxis, np.newaxis] + fresh
        self.at_ns[robots] = np.maximum(at_ns, self.at_ns[robots])
        self.position[robots], self._passed[robots] = position, passed
        self.views[robots] += 1
        unsure = robots[at_ns - self._gained_ns[robots] > self.usual.seconds * NS]
        self.sure[unsure], self._trust[unsure] = False, np.minimum(self._trust[unsure], FIRST_TRUST)

    def pose_covariance(self, robots: Rows, away: Floats) -> Floats:
        """Return the covariance (n, 3; xx, xy, yy) that poses give places that are `away` (n, 2) from the cameras."""
        c = self.covariance[robots]
        x, y = away.T
        return np.stack(
            [
                c[:, 0, 0] - 2 * y * c[:, 0, 2] + y * y * c[:, 2, 2],
                c[:, 0, 1] + x * c[:, 0, 2] - y * c[:, 1, 2] - x * y * c[:, 2, 2],
                c[:, 1, 1] + 2 * x * c[:, 1, 2] + x * x * c[:, 2, 2],
            ],
            axis=1,
        )

    def correct(self, robots: Rows, away: Floats, moved: Floats, covariance: Floats) -> None:
        """Learn from things known before. robots: of each. moved: (n, 2) where it seems to be, less where it is.

        covariance: (n, 3; xx, xy, yy) of that, the pose's left out.
        """
        which, group = np.unique(robots, return_inverse=True)
        if not len(which):
            return
        normal, vector = _sums(group, len(which), away, moved, covariance)
        normal += np.diag(1 / (4 * self.usual.variance))
        spread = np.linalg.inv(normal)
        seen = np.einsum("rij,rj->ri", spread, vector)
        repeated = np.maximum(1.0, self.usual.seconds / np.maximum(self._passed[which], 0.1) * REPEATED)
        before = self.covariance[which]
        noise = spread + np.diag(SYSTEMATIC) * repeated[:, np.newaxis, np.newaxis]
        gain = before @ np.linalg.inv(before + noise)
        self.state[which] -= np.einsum("rij,rj->ri", gain, seen)
        self.covariance[which] = (np.identity(3) - gain) @ before

    def judge(
        self,
        robots: Rows,
        expected: Whole,
        found: Whole,
        *,
        looked_past: Whole | None = None,
        strange: Whole | None = None,
        seen_by_others: Whole | None = None,
        floor_m: Floats | None = None,
    ) -> Bools:
        """Doubt poses when views contradict what is known; trust them again when they fit.

        expected, found: how many known objects each view should show, and how many of them it shows. looked_past: how
        many it looks past. strange: how many things it shows that are not known. seen_by_others: how many of the missed
        ones another robot saw. floor_m: how high the floor is that it shows. Returns which views' depth may be right.
        """
        looked_past, strange, seen_by_others = (
            np.zeros_like(expected) if each is None else each for each in (looked_past, strange, seen_by_others)
        )
        floor_m = np.full(len(robots), np.inf) if floor_m is None else floor_m
        missed, doubted, sure = expected - found, self.doubted[robots], self.sure[robots]
        # what only this robot knew may have changed while it was away, and more may have been brought than taken
        own = seen_by_others == 0
        strange = np.where(own, np.minimum(strange, missed), strange)
        nothing_expected = expected == 0
        fits = ~nothing_expected & (found >= MIN_FOUND_SHARE * expected)
        shows_floor, deep = self.floors.compare(self._camera[robots], floor_m)
        deep &= ~fits
        unlike = ~nothing_expected & ~fits & ~deep
        telling = (looked_past > 0) | (missed > 1)  # the detector may miss one that is there
        elsewhere = unlike & telling & (strange >= MIN_NEW_PER_MISSED * missed)
        emptied = unlike & ~elsewhere & (looked_past >= MIN_EMPTIED_SHARE * missed) & shows_floor
        astray = (doubted == LOST) | (doubted == JUMPED)
        wrong = elsewhere | (deep & ~nothing_expected)
        counts = self._counts(robots, wrong)
        contradicts = elsewhere | (emptied & astray)  # those who may be anywhere look past all that is not there
        moved_on = self._moved_on(robots, contradicts | (emptied & ~sure))
        self._contradicted += int((contradicts & moved_on).sum())
        changed = contradicts & (self._contradicted >= CHANGED_VIEWS)
        wrong &= ~changed
        weight = np.where(
            deep, OBJECTS_COUNTED_PER_VIEW, np.minimum(np.where(own, missed, expected), OBJECTS_COUNTED_PER_VIEW)
        )
        others = np.where(deep, MOST_NEW_OBJECTS_COUNTED, np.minimum(strange, MOST_NEW_OBJECTS_COUNTED))
        cost = np.where(sure, weight * TRUST_PER_OBJECT, others * PENALTY_PER_NEW_OBJECT)
        alone = nothing_expected & ((doubted == JUMPED) | ((doubted == WRONG_DEPTH) & shows_floor))
        gained = np.where(fits, np.minimum(expected, OBJECTS_COUNTED_PER_VIEW) * TRUST_PER_OBJECT, 0)
        gained += np.where(emptied & ~astray & (sure | moved_on), TRUST_PER_EMPTIED_VIEW, 0)
        gained += np.where(changed | alone, TRUST_VIEWS, 0)
        gained -= np.where(wrong & counts, cost, 0)
        trust = np.clip(self._trust[robots] + gained, 0, MOST_TRUST)
        self._trust[robots] = np.where(wrong & (doubted != RIGHT), 0, trust)
        self._gained_ns[robots[gained > 0]] = self.at_ns[robots[gained > 0]]
        full = (trust >= MOST_TRUST) & (gained > 0)
        self.doubted[robots[full]], self.sure[robots[full]] = RIGHT, True
        if (full & fits).any():
            self._contradicted = 0
        self.floors.learn(self._camera[robots[full & fits]], floor_m[full & fits])
        lost = wrong & (doubted == RIGHT) & (trust == 0)
        self._forget(robots[lost & ~deep], LOST)
        self._forget(robots[lost & deep], WRONG_DEPTH)
        return np.asarray(~deep)

    def _counts(self, robots: Rows, wrong: Bools) -> Bools:
        """Return which of the wrong views count: of the cameras of a robot that look at one time, the first one's."""
        passed = self.at_ns[robots] - self._wrong_ns[robots]
        counts = wrong & (2 * passed >= self.interval_ns[robots])
        self._wrong_ns[robots[counts]] = self.at_ns[robots[counts]]
        return counts

    def _moved_on(self, robots: Rows, which: Bools) -> Bools:
        """Return which views of these were taken far enough from where the robot's last such view was."""
        away = np.hypot(*(self.position[robots] - self._counted[robots])[:, :2].T)
        other = self._camera[robots] != self._counted_by[robots]
        moved = which & (away >= MOVED_M + np.where(other, BETWEEN_CAMERAS_M, 0.0))
        self._counted[robots[moved]] = self.position[robots[moved]]
        self._counted_by[robots[moved]] = self._camera[robots[moved]]
        return np.asarray(moved)

    def forget(self, robots: Rows, cameras: Rows) -> None:
        """Begin anew with robots and cameras whose numbers are for others from now on."""
        self._forget(robots, RIGHT)
        self._gained_ns[robots], self._wrong_ns[robots] = 0, 0
        self.at_ns[robots], self.views[robots], self._passed[robots] = 0, 0, 0.0
        self._cameras.forget(cameras)
        self.floors.forget(cameras)

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now: the clock was set back."""
        np.minimum(self.at_ns, now_ns, out=self.at_ns)
        for times in (self._gained_ns, self._wrong_ns):
            np.minimum(times, now_ns, out=times)
        self._cameras.set_back(now_ns)

    def _forget(self, robots: Rows, why: int) -> None:
        self.state[robots] = 0.0
        self.covariance[robots] = np.diag(self.usual.variance)
        self.doubted[robots], self.sure[robots] = why, False
        self._trust[robots] = FIRST_TRUST if why == RIGHT else 0
        self._counted[robots] = np.inf


class _LastPoses:
    """Where each camera was last, and when; a robot may have several, far from each other."""

    def __init__(self) -> None:
        self._at_ns = np.zeros(0, np.int64)
        self._position = np.zeros((0, 3))

    def forget(self, cameras: Rows) -> None:
        """Forget where cameras were."""
        self._at_ns[cameras[cameras < len(self._at_ns)]] = 0

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now."""
        np.minimum(self._at_ns, now_ns, out=self._at_ns)

    def move(self, cameras: Rows, at_ns: NDArray[np.int64], position: Floats) -> tuple[Bools, NDArray[np.int64]]:
        """Return which cameras moved faster than robots do, and how long ago their last views were, in nanoseconds."""
        self._reserve(int(cameras.max(initial=-1)) + 1)
        before = self._at_ns[cameras]
        passed_ns = np.maximum(at_ns - before, 0)
        moved = np.hypot(*(position - self._position[cameras])[:, :2].T)
        self._at_ns[cameras], self._position[cameras] = at_ns, position
        return (before > 0) & (moved > JUMP_M + JUMP_M_S * passed_ns / NS), passed_ns

    def _reserve(self, count: int) -> None:
        more = count - len(self._at_ns)
        if more > 0:
            more += _FIRST
            self._at_ns = np.concatenate([self._at_ns, np.zeros(more, np.int64)])
            self._position = np.concatenate([self._position, np.zeros((more, 3))])


def _sums(group: Rows, count: int, away: Floats, moved: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return each robot's normal matrix (3 x 3) and vector of x, y, yaw, outliers pulling little."""
    xx, xy, yy = covariance.T
    det = xx * yy - xy * xy
    weights = np.stack([yy, -xy, -xy, xx], axis=1).reshape(-1, 2, 2) / det[:, np.newaxis, np.newaxis]
    size = np.einsum("ni,nij,nj->n", moved, weights, moved)
    weights *= np.minimum(1.0, OUTLIER / np.maximum(size, 1e-9))[:, np.newaxis, np.newaxis]
    design = np.zeros((len(moved), 2, 3))
    design[:, 0, 0] = design[:, 1, 1] = 1.0
    design[:, 0, 2], design[:, 1, 2] = -away[:, 1], away[:, 0]
    pulled = np.einsum("nki,nkl->nil", design, weights)
    normal, vector = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(normal, group, pulled @ design)
    np.add.at(vector, group, np.einsum("nil,nl->ni", pulled, moved))
    return normal, vector
