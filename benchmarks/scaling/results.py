"""What a subscriber saw of the results, and what that says of who looked after which camera when. Pure."""

import statistics
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

FrameId = tuple[str, str, int]
"""Camera, gateway process and number."""


@dataclass(frozen=True, slots=True)
class Result:
    """A class list that arrived at a time, in seconds. age_s: of its frame by then, since the gateway had it."""

    at_s: float
    camera: str
    worker: str
    frame: FrameId
    age_s: float


@dataclass(frozen=True, slots=True)
class Change:
    """A camera's way from one worker to another: when the old one's last and the new one's first result came.

    usual_s: the median time between two results of the camera before.
    """

    camera: str
    old: str
    new: str
    last_s: float
    first_s: float
    usual_s: float

    @property
    def double_s(self) -> float:
        """How long results came from both."""
        return max(0.0, self.last_s - self.first_s)

    @property
    def interval_s(self) -> float:
        """How long no result came in between."""
        return max(0.0, self.first_s - self.last_s)

    @property
    def gap_s(self) -> float:
        """How much longer no result came than usual."""
        return max(0.0, self.interval_s - self.usual_s)


class Log:
    """Results in the order in which they came."""

    def __init__(self, results: Iterable[Result]) -> None:
        self._results = sorted(results, key=lambda result: result.at_s)

    def between(self, from_s: float, to_s: float) -> "Log":
        """Return what came in a span of time."""
        return Log(result for result in self._results if from_s <= result.at_s < to_s)

    def of(self, camera: str) -> Sequence[Result]:
        """Return what came of a camera."""
        return [result for result in self._results if result.camera == camera]

    def frames(self) -> int:
        """Return how many different frames there are results of."""
        return len({result.frame for result in self._results})

    def ages_s(self) -> list[float]:
        """Return the age of every result."""
        return [result.age_s for result in self._results]

    def workers(self) -> dict[str, set[str]]:
        """Return who sent results of each camera."""
        found: defaultdict[str, set[str]] = defaultdict(set)
        for result in self._results:
            found[result.camera].add(result.worker)
        return dict(found)

    def owners(self) -> dict[str, str]:
        """Return who sent the last result of each camera."""
        return {result.camera: result.worker for result in self._results}

    def first_after(self, at_s: float, camera: str, other_than: str) -> float | None:
        """Return when the first result of a camera came after a time from anybody but one worker."""
        found = (result.at_s for result in self.of(camera) if result.at_s >= at_s and result.worker != other_than)
        return next(found, None)

    def first_of_frame_after(self, at_s: float) -> float | None:
        """Return when the first result came of a frame that its gateway had after a time."""
        return next((result.at_s for result in self._results if result.at_s - result.age_s >= at_s), None)

    def longest_interval_s(self) -> float:
        """Return the longest time between two results of one camera."""
        by_camera: defaultdict[str, list[float]] = defaultdict(list)
        for result in self._results:
            by_camera[result.camera].append(result.at_s)
        intervals = (after - before for times in by_camera.values() for before, after in pairwise(times))
        return max(intervals, default=0.0)

    def changes(self, before: "Log") -> list[Change]:
        """Return the cameras whose owner is not the one they had `before`, one change each."""
        old_owners, new_owners = before.owners(), self.owners()
        moved = [camera for camera, old in old_owners.items() if new_owners.get(camera, old) != old]
        return [self._change(camera, old_owners[camera], new_owners[camera], before) for camera in moved]

    def _change(self, camera: str, old: str, new: str, before: "Log") -> Change:
        earlier, later = before.of(camera), self.of(camera)
        last_s = max(result.at_s for result in [*earlier, *later] if result.worker == old)
        first_s = min(result.at_s for result in later if result.worker == new)
        intervals = [after.at_s - one.at_s for one, after in pairwise(earlier)]
        return Change(camera, old, new, last_s, first_s, statistics.median(intervals) if intervals else 0.0)
