"""Runs Ultralytics' trackers, one per camera. They do not use appearance, so they download no model."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from ultralytics.engine.results import Boxes
from ultralytics.trackers.bot_sort import BOTSORT
from ultralytics.trackers.byte_tracker import BYTETracker
from ultralytics.trackers.utils.kalman_filter import KalmanFilterXYWH
from ultralytics.utils import ROOT, YAML, IterableSimpleNamespace

from schemas.detections import Detection
from schemas.image import ImageFrame
from services.detector.pixels import glance
from services.detector.runtime.overlap import at_border, boxes_of, overlaps
from services.detector.tracking.camera_motion import Motion, moved
from services.detector.tracking.confirmed_tracks import LEAST, NEUTRAL, ConfirmedTracks

Kind = Literal["bytetrack", "botsort"]

NUMBER: Final = 4
SCORE: Final = 5
INDEX: Final = 7
"""Places in a tracker's rows: left, top, right, bottom, number, score, class, index of the object."""

LOOKED_AT: Final = 160
"""The width in pixels at which images are compared."""

LOST_NS: Final = 2_000_000_000
"""How long what is not found is looked for, whatever the camera's rate."""

MAX_FRAMES_LOST: Final = 1_000

OURS: Final[dict[Kind, dict[str, Any]]] = {
    "bytetrack": {"fuse_score": False},
    "botsort": {
        "fuse_score": False,
        "match_thresh": 0.9,
        "track_high_thresh": 0.0,
        "new_track_thresh": 0.0,
        "gmc_method": "none",
    },
}
"""Settings other than Ultralytics'. Fused with scores, the overlap of what a model is not sure of is never enough to be
followed; a place that is moved with its own part of the image may be believed at less overlap. What low scores are
matched with apart from others, as ByteTrack does, is not `get_dists`, and may be of another class."""


class LastSeen(KalmanFilterXYWH):
    """Replaces the Kalman filter: an object is at its last position, moved with the image."""

    def update(
        self, mean: NDArray[Any], covariance: NDArray[Any], measurement: NDArray[Any], confidence: float | None = None
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return the state (centre, size, speeds of 0) that is the measurement."""
        del mean, confidence
        return np.concatenate([measurement, np.zeros_like(measurement)]), covariance


class MovingBOTSORT(BOTSORT):
    """BoT-SORT whose tracks move with the image inside their boxes, instead of with one motion of the camera.

    An image that it is given (`update`) is the flow since the last one; see `Motion.look`. `size`: width and height of
    the real one. A detection goes on with tracks of its class alone.
    """

    def __init__(self, args: IterableSimpleNamespace) -> None:
        super().__init__(args)
        self.size = (0, 0)
        self._at_border: dict[int, NDArray[np.bool_]] = {}

    def get_kalmanfilter(self) -> LastSeen:
        """See `LastSeen`."""
        return LastSeen()  # type: ignore[no-untyped-call]

    def multi_predict(self, tracks: list[Any]) -> None:
        """Leave tracks in place: only the image moves them."""

    def _pre_first_associate(self, pool: list[Any], unconfirmed: list[Any], flow: Any, results_high: Any) -> None:
        del results_high
        tracks = [*pool, *unconfirmed]
        boxes = np.array([each.xyxy for each in tracks]).reshape(-1, 4)
        self._at_border = dict(zip((each.track_id for each in tracks), at_border(boxes, self.size), strict=True))
        if flow is None or not tracks:
            return
        places = moved(boxes, flow, flow.shape[1] / self.size[0])
        for track, place in zip(tracks, places, strict=True):
            track.mean[:2], track.mean[2:4] = (place[:2] + place[2:]) / 2, place[2:] - place[:2]

    def get_dists(self, tracks: list[Any], detections: list[Any]) -> NDArray[np.float32]:
        """Return tracks x detections: 1 minus their overlap; 1 where classes differ."""
        boxes, found = (np.array([each.xyxy for each in many]).reshape(-1, 4) for many in (tracks, detections))
        cut = np.array([self._at_border[each.track_id] for each in tracks], np.bool_).reshape(-1, 4)
        same = np.equal.outer([each.cls for each in tracks], [each.cls for each in detections])
        return np.where(same, 1 - overlaps(boxes, found, cut, self.size), 1).astype(np.float32)

    def _format_output(self) -> NDArray[np.float32]:
        """Return this frame's tracks, including new ones: evidence confirms them, not the count."""
        return np.array([each.result for each in self.tracked_stracks], np.float32)


CLASSES: Final[dict[Kind, type[Any]]] = {"bytetrack": BYTETracker, "botsort": MovingBOTSORT}


class UltralyticsTracker:
    """Follows the objects of one camera.

    neutral: returns the score that speaks neither for a thing nor against it now; see `ConfirmedTracks`.
    """

    def __init__(self, kind: Kind, neutral: Callable[[], float] = lambda: NEUTRAL) -> None:
        settings = {**YAML.load(ROOT / "cfg" / "trackers" / f"{kind}.yaml"), **OURS[kind]}
        self._tracker = CLASSES[kind](IterableSimpleNamespace(**settings))
        self._least_score = float(settings["new_track_thresh"])
        self._motion = Motion() if kind == "botsort" else None
        self._neutral = neutral
        self._evidence = ConfirmedTracks(neutral())
        self._times_ns: deque[int] = deque(maxlen=MAX_FRAMES_LOST)

    def update(self, objects: Sequence[Detection], frame: ImageFrame) -> Sequence[int | None]:
        """See `Tracker.update`."""
        self._take_neutral(self._neutral())
        scores = np.array([(max(each.score, LEAST), each.label) for each in objects]).reshape(-1, 2)
        rows = np.concatenate([boxes_of(objects), scores], axis=1).astype(np.float32)
        boxes = Boxes(rows, (frame.height, frame.width))
        self._tracker.max_frames_lost = self._frames_until(frame.header.received_ns)
        flow = None
        if self._motion is not None:
            self._tracker.size = (frame.width, frame.height)
            flow = self._motion.look(glance(frame, LOOKED_AT))
        tracks = self._tracker.update(boxes, flow).reshape(-1, INDEX + 1)
        numbers: list[int | None] = [None] * len(objects)
        earned = self._evidence.weigh((int(row[NUMBER]), float(row[SCORE])) for row in tracks)
        for row, number in zip(tracks, earned, strict=True):
            numbers[int(row[INDEX])] = number
        return numbers

    def _take_neutral(self, neutral: float) -> None:
        """Have every object whose score speaks for it begin a track, also where a model's scores are all low."""
        self._evidence.neutral = neutral
        least = min(self._least_score, neutral)
        self._tracker.args.track_high_thresh = self._tracker.args.new_track_thresh = least

    def _frames_until(self, now_ns: int) -> int:
        """Return the maximum number of frames since an object was last seen for the next frame to find it again."""
        self._times_ns.append(now_ns)
        while self._times_ns[0] < now_ns - LOST_NS:
            self._times_ns.popleft()
        return len(self._times_ns) - 2
