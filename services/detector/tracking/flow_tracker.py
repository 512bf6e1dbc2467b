"""Follows boxes from frame to frame by where the image moved: BoT-SORT's steps with optical flow in its place. Pure.

Of BoT-SORT (Aharon et al., 2022) it has the order in which tracks and detections are associated, and that new tracks
wait for a second sighting to be as sure as others. Its Kalman filter and its one motion of the camera are replaced: a
track stays where it was seen, and moves with the image inside its box (`camera_motion`).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import lap
import numpy as np
from numpy.typing import NDArray

from services.detector.runtime.overlap import Floats, at_border, ious, overlaps
from services.detector.tracking.camera_motion import moved

MOST_APART: Final = 0.9
"""Cost (1 - overlap) up to which a detection goes on with a track that was seen twice. A place that is moved with its
own part of the image may be believed at little overlap."""

MOST_APART_NEW: Final = 0.7
"""The same for a track that was seen once."""

SAME: Final = 0.85
"""IoU above which a lost track and one that is seen are one thing; the longer one is kept."""


@dataclass(slots=True)
class _Track:
    """One thing. box: left, top, right, bottom in pixels. detection: index of the last. first, last: its frames."""

    number: int
    box: Floats
    label: int
    detection: int
    first: int
    last: int
    confirmed: bool

    @property
    def length(self) -> int:
        return self.last - self.first


class FlowTracker:
    """The tracks of one camera, numbered from 1 in the order of their first frames."""

    def __init__(self) -> None:
        self._seen: list[_Track] = []
        self._lost: list[_Track] = []
        self._frame = 0
        self._count = 0

    def update(
        self, boxes: Floats, labels: Sequence[int], flow: Floats | None, size: tuple[int, int], frames_lost: int
    ) -> list[tuple[int, int]]:
        """Take the next frame's detections; return pairs of a track's number and the index of its detection.

        boxes: n x 4, corners in pixels. labels: of their classes (n); a detection goes on with tracks of its class
        alone. flow: how the image moved since the last frame, see `Motion.look`. size: width and height of the image.
        frames_lost: the number of frames within which a track is found again.
        """
        self._frame += 1
        left = [index for index, (x1, y1, x2, y2) in enumerate(boxes.tolist()) if x1 < x2 and y1 < y2]
        known = [*(each for each in self._seen if each.confirmed), *self._lost]
        new = [each for each in self._seen if not each.confirmed]
        cut = self._moved([*known, *new], flow, size)
        for tracks, cut_off, most in ((known, cut[: len(known)], MOST_APART), (new, cut[len(known) :], MOST_APART_NEW)):
            overlap = overlaps(_boxes(tracks), boxes[left], cut_off, size)
            same = np.equal.outer([each.label for each in tracks], [labels[index] for index in left])
            pairs = _assigned(np.where(same, 1 - overlap, 1), most)
            for row, column in pairs:
                tracks[row].detection, tracks[row].last = left[column], self._frame
                tracks[row].box = boxes[left[column]]
            taken = {column for _, column in pairs}
            left = [index for column, index in enumerate(left) if column not in taken]
        begun = [self._begun(index, boxes[index], labels[index]) for index in left]
        self._sort(begun, frames_lost)
        return [(each.number, each.detection) for each in self._seen]

    def _moved(self, tracks: Sequence[_Track], flow: Floats | None, size: tuple[int, int]) -> NDArray[np.bool_]:
        """Move tracks with the image; return which of their sides (n x 4) its border may have cut before that."""
        boxes = _boxes(tracks)
        if flow is not None and tracks:
            for track, box in zip(tracks, moved(boxes, flow, flow.shape[1] / size[0]), strict=True):
                track.box = box
        return at_border(boxes, size)

    def _begun(self, detection: int, box: Floats, label: int) -> _Track:
        self._count += 1
        confirmed = self._frame == 1  # nothing was there before that it may be mistaken for
        return _Track(self._count, box, label, detection, self._frame, self._frame, confirmed)

    def _sort(self, begun: list[_Track], frames_lost: int) -> None:
        """Have each track seen or lost, and give up those that were seen once, or last too long ago."""
        missed = [each for each in self._seen if each.last < self._frame and each.confirmed]
        again = [each for each in self._lost if each.last == self._frame]
        still = [each for each in self._seen if each.last == self._frame]
        for each in still:
            each.confirmed = True
        oldest = self._frame - frames_lost
        lost = [each for each in self._lost if oldest < each.last < self._frame] + missed
        seen = [*still, *begun, *again]
        doubles = ious(_boxes(seen), _boxes(lost)) > SAME
        longer = np.greater.outer([each.length for each in seen], [each.length for each in lost])
        self._seen = _without(seen, doubles & ~longer)
        self._lost = _without(lost, (doubles & longer).T)


def _boxes(tracks: Iterable[_Track]) -> Floats:
    return np.array([each.box for each in tracks], np.float64).reshape(-1, 4)


def _without(tracks: Iterable[_Track], doubles: NDArray[np.bool_]) -> list[_Track]:
    """Return the tracks that are the double of no other one. doubles: tracks x others."""
    return [each for each, others in zip(tracks, doubles, strict=True) if not others.any()]


def _assigned(costs: Floats, most: float) -> list[tuple[int, int]]:
    """Return the pairs of rows and columns that cost least together, none of which costs more than `most`."""
    if not costs.size:
        return []
    _, columns, _ = lap.lapjv(costs, extend_cost=True, cost_limit=most)
    return [(row, column) for row, column in enumerate(columns.tolist()) if column >= 0]
