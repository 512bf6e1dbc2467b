"""Joins detections with the points of their instant and the transforms of both. Pure."""

from collections import deque
from dataclasses import dataclass, replace
from typing import Final

from bus.sharing.work_counts import Tally
from schemas.camera_info import CameraInfo
from schemas.detections import Detections
from schemas.header import FrameOrder, Header
from schemas.points import PointCloud
from schemas.transforms import Transforms
from services.geometry.errors import TooNewError, TransformError
from services.geometry.memory_budget import MemoryBudget
from services.geometry.transforms import FIXED_FRAMES, TransformTree
from services.worker.stamp_joiner import Joiner, NoPartner, Partner

REPLACED: Final = "replaced by newer detections"
DUPLICATE: Final = "the same detections again, or older ones"
MALFORMED: Final = "malformed detections"
MALFORMED_POINTS: Final = "malformed points"
MALFORMED_INFO: Final = "malformed camera info"
MALFORMED_TRANSFORMS: Final = "malformed transforms"
TOO_MANY_POINTS: Final = "points: too many at once"
TOO_MANY_TRANSFORMS: Final = "transforms: too many at once"
UNSTAMPED: Final = "points without a stamp"
UNJOINED: Final = "no points of the same instant"
UNPLACED: Final = "points that cannot be brought to the picture"
FAILED: Final = "failed"


POINTS_WAIT_S: Final = 0.3
"""Seconds that detections wait for points and transforms: more than a lidar's turn, less than news stays fresh."""

NO_STAMP: Final = "the image has no stamp"
POINTS: Final = "points"
TRANSFORMS: Final = "transforms"
MAX_WAITING: Final = 16


@dataclass(frozen=True, slots=True)
class Matched:
    """Detections with the points of their instant, or why there are none. waited_s: waiting time for them."""

    detections: Detections
    cloud: PointCloud | None
    unknown: str = ""
    waited_s: float = 0.0


class CloudJoiner:
    """Joins one camera's detections with its points; only the newest complete ones count.

    target: the frame that transforms are waited for to. tolerance_ns, budget: see `Joiner`. Time is any steady clock's,
    in seconds.
    """

    def __init__(
        self, tally: Tally, *, target: str, tolerance_ns: int | None = None, budget: MemoryBudget | None = None
    ) -> None:
        self._tally = tally
        self._target = target
        self._clouds: Joiner[PointCloud] = Joiner(POINTS, tolerance_ns=tolerance_ns, budget=budget)
        self._waiting: deque[tuple[Detections, float]] = deque()
        self._order = FrameOrder()
        self.tree = TransformTree(budget=budget)
        self.info: CameraInfo | None = None

    @property
    def until_s(self) -> float | None:
        """Deadline of the oldest waiting detections; None if none are waiting."""
        return self._waiting[0][1] + POINTS_WAIT_S if self._waiting else None

    def detections(self, found: Detections, now_s: float) -> None:
        """Add detections newer than the last; at a take-over one of two workers may lag behind."""
        if not self._order.take(found.header, round(now_s * 1e9)):
            self._tally.dropped[DUPLICATE] += 1
            return
        if len(self._waiting) >= MAX_WAITING:
            self._drop(1)
        self._waiting.append((found, now_s))

    def points(self, cloud: PointCloud) -> None:
        """Add points; they are kept for the detections of their instant. Those without a stamp have none."""
        if not cloud.header.stamp_ns:
            self._tally.dropped[UNSTAMPED] += 1
            return
        self._clouds.keep(cloud.header.stamp_ns, cloud, cloud.data.nbytes)
        self._count()

    def transforms(self, sent: Transforms, *, static: bool) -> None:
        """Add transforms of the robot."""
        self.tree.take(sent, static=static)
        self._count()

    def take(self, now_s: float) -> Matched | None:
        """Return the newest detections that are complete, or whose waiting time has ended.

        Those that waited before them are dropped.
        """
        for look in (self._joined, self._given_up):
            for place in reversed(range(len(self._waiting))):
                found, since_s = self._waiting[place]
                if (matched := look(found, late=now_s >= since_s + POINTS_WAIT_S)) is not None:
                    self._drop(place)
                    self._waiting.popleft()
                    return replace(matched, waited_s=now_s - since_s)
        return None

    def end(self) -> int:
        """Forget everything that belongs to an instant; return the number of detections that waited."""
        self._count()
        waited = len(self._waiting)
        self._waiting.clear()
        self._clouds.flush()
        self._clouds.dropped.clear()
        self.tree.flush()
        self._newest = None
        return waited

    def _count(self) -> None:
        self._tally.add(POINTS, self._clouds.dropped)
        self._tally.add(TRANSFORMS, self.tree.rejected)

    def _drop(self, count: int) -> None:
        self._tally.dropped[REPLACED] += count
        for _ in range(count):
            self._waiting.popleft()

    def _joined(self, found: Detections, *, late: bool) -> Matched | None:
        match self._clouds.find(found.header.stamp_ns):
            case Partner(cloud, final=final) if late or (final and self._is_placed(found.header, cloud.header)):
                return Matched(found, cloud)
        return None

    def _given_up(self, found: Detections, *, late: bool) -> Matched | None:
        if not found.header.stamp_ns:
            return Matched(found, None, NO_STAMP)
        match self._clouds.find(found.header.stamp_ns):
            case NoPartner(reason, final) if final or late:
                return Matched(found, None, reason)
        return None

    def _is_placed(self, picture: Header, points: Header) -> bool:
        """Return whether no transform can still arrive."""
        if any(self._is_open(to, points) for to in {self._target, picture.frame_id} - {"", points.frame_id}):
            return False
        if picture.stamp_ns == points.stamp_ns:
            return True
        for fixed in FIXED_FRAMES:
            still = {self._is_open(fixed, each) for each in (picture, points)}
            if False not in still:
                return still == {None}
        return True

    def _is_open(self, target: str, source: Header) -> bool | None:
        """Return whether a transform may still become known; None where it is known."""
        try:
            self.tree.lookup(target, source.frame_id, source.stamp_ns)
        except TransformError as error:
            return isinstance(error, TooNewError)
        return None
