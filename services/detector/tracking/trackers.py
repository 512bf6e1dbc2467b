"""Follows the objects of a camera: a tracker's association, and the numbers that its tracks earn."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Final, Literal, Protocol

import numpy as np

from schemas.detections import Detection
from schemas.image import ImageFrame
from services.detector.pixels import small_grey_image
from services.detector.runtime.overlap import boxes_of
from services.detector.tracking.camera_motion import Motion
from services.detector.tracking.confirmed_tracks import LEAST, NEUTRAL, ConfirmedTracks
from services.detector.tracking.flow_tracker import FlowTracker

Kind = Literal["bytetrack", "botsort"]

LOOKED_AT: Final = 160
"""The width in pixels at which images are compared."""

LOST_NS: Final = 2_000_000_000
"""How long what is not found is looked for, whatever the camera's rate."""

MAX_FRAMES_LOST: Final = 1_000

NUMBER: Final = 4
INDEX: Final = 7
"""Places in the rows of Ultralytics' trackers: left, top, right, bottom, number, score, class, index of the object."""

BYTETRACK: Final = {"fuse_score": False}
"""Settings other than Ultralytics'. Fused with scores, the overlap of what a model is not sure of is never enough to be
followed."""


class Association(Protocol):
    """Finds out which detections are of one thing."""

    def update(
        self, objects: Sequence[Detection], frame: ImageFrame, frames_lost: int, least: float
    ) -> list[tuple[int, int]]:
        """Take the next frame's objects; return pairs of a track's own number and the index of its object.

        frames_lost: the number of frames within which a track is found again. least: the score that begins a
        track.
        """


class ByteTrack:
    """Ultralytics' ByteTrack. It uses no appearance, so it downloads no model."""

    def __init__(self) -> None:
        from ultralytics.trackers.byte_tracker import BYTETracker  # noqa: PLC0415 - it needs torch
        from ultralytics.utils import ROOT, YAML, IterableSimpleNamespace  # noqa: PLC0415 - as above

        settings = {**YAML.load(ROOT / "cfg" / "trackers" / "bytetrack.yaml"), **BYTETRACK}
        self._least_score = float(settings["new_track_thresh"])
        self._tracker: Any = BYTETracker(IterableSimpleNamespace(**settings))

    def update(
        self, objects: Sequence[Detection], frame: ImageFrame, frames_lost: int, least: float
    ) -> list[tuple[int, int]]:
        """See `Association.update`. Tracks begin also where a model's scores are all low."""
        from ultralytics.engine.results import Boxes  # noqa: PLC0415 - it needs torch

        needed = min(self._least_score, least)
        self._tracker.args.track_high_thresh = self._tracker.args.new_track_thresh = needed
        self._tracker.max_frames_lost = frames_lost - 2  # what it gave up it finds for one frame more
        scores = np.array([(max(each.score, LEAST), each.label) for each in objects]).reshape(-1, 2)
        rows = np.concatenate([boxes_of(objects), scores], axis=1).astype(np.float32)
        tracks = self._tracker.update(Boxes(rows, (frame.height, frame.width))).reshape(-1, INDEX + 1)
        return [(int(row[NUMBER]), int(row[INDEX])) for row in tracks]


class ByFlow:
    """Our own, by optical flow; see `flow_tracker`."""

    def __init__(self) -> None:
        self._tracker = FlowTracker()
        self._motion = Motion()

    def update(
        self, objects: Sequence[Detection], frame: ImageFrame, frames_lost: int, least: float
    ) -> list[tuple[int, int]]:
        """See `Association.update`. Every object begins a track: evidence confirms them, not the first score."""
        del least
        flow = self._motion.look(small_grey_image(frame, LOOKED_AT))
        labels = [each.label for each in objects]
        return self._tracker.update(boxes_of(objects), labels, flow, (frame.width, frame.height), frames_lost)


ASSOCIATIONS: Final[dict[Kind, Callable[[], Association]]] = {"bytetrack": ByteTrack, "botsort": ByFlow}


class CameraTracker:
    """Follows the objects of one camera.

    neutral: returns the score that speaks neither for a thing nor against it now; see `ConfirmedTracks`.
    """

    def __init__(self, kind: Kind, neutral: Callable[[], float] = lambda: NEUTRAL) -> None:
        self._association = ASSOCIATIONS[kind]()
        self._neutral = neutral
        self._evidence = ConfirmedTracks(neutral())
        self._times_ns: deque[int] = deque(maxlen=MAX_FRAMES_LOST)

    def update(self, objects: Sequence[Detection], frame: ImageFrame) -> Sequence[int | None]:
        """See `Tracker.update`."""
        self._evidence.neutral = self._neutral()
        frames_lost = self._frames_until(frame.header.received_ns)
        tracks = self._association.update(objects, frame, frames_lost, self._evidence.neutral)
        numbers: list[int | None] = [None] * len(objects)
        earned = self._evidence.weigh((track, max(objects[index].score, LEAST)) for track, index in tracks)
        for (_, index), number in zip(tracks, earned, strict=True):
            numbers[index] = number
        return numbers

    def _frames_until(self, now_ns: int) -> int:
        """Return the number of frames, this one included, since LOST_NS ago."""
        self._times_ns.append(now_ns)
        while self._times_ns[0] < now_ns - LOST_NS:
            self._times_ns.popleft()
        return len(self._times_ns)
