"""What is followed on drives against what is truly there: which tracks lie on which objects.

A track lies on an object of its class with an IoU of at least `LEAST_IOU`: of boxes, as multi-object tracking defines
it (MOTChallenge, after Ristani et al., 2016), the true one being that around what is visible; and of masks, as multi-
object tracking and segmentation does (Voigtlaender et al., "MOTS", 2019).

Objects asked for, and ignore regions, are those of the average precision (see `precision`) in both: a track's detection
that is not the match of an object asked for, and whose mask lies on another object of its class with at least
`LEAST_IOU` of itself, is neither right nor wrong, and that object is not missed. Which objects are asked for is decided
frame by frame: one that is not for a while keeps its identity, and what its track does meanwhile is ignored. What has
no track is not followed.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from pycocotools import mask as coco

from benchmarks.accuracy.drives import HZ, HeldOutDrive, Seen
from benchmarks.accuracy.identities import Floats, Frame, Identities, assigned, identities
from schemas.detections import Detection
from services.toolbox.train.inference import Follow

LEAST_IOU: Final = 0.5


@dataclass(frozen=True, slots=True)
class Tally:
    """Sums over drives. detected: the object-frames asked for that any detection, tracked or not, lies on."""

    identities: Identities = field(default_factory=Identities)
    detected: int = 0

    def __add__(self, other: "Tally") -> "Tally":
        return Tally(self.identities + other.identities, self.detected + other.detected)


@dataclass(frozen=True, slots=True)
class Followed:
    """The same tracks by the overlap of boxes and by that of masks."""

    boxes: Tally
    masks: Tally
    frames: int


def followed(drives: Iterable[HeldOutDrive], follow: Follow, report: Callable[[int], None]) -> Followed:
    """Show each drive to `follow`, and report how many are done."""
    boxes, masks, frames = Tally(), Tally(), 0
    for done, drive in enumerate(drives, start=1):
        found = follow((frame.image() for frame in drive.frames), HZ)
        pairs = [(frame.seen, each) for frame, each in zip(drive.frames, found, strict=True)]
        boxes += _tally([sighting(*each, box_overlap) for each in pairs])
        masks += _tally([sighting(*each, mask_overlap) for each in pairs])
        frames += len(pairs)
        report(done)
    return Followed(boxes, masks, frames)


@dataclass(frozen=True, slots=True)
class Sighting:
    """A frame's tracks among its objects, and how many of these any detection, tracked or not, lies on."""

    frame: Frame
    detected: int


def _tally(sightings: Sequence[Sighting]) -> Tally:
    found = identities((each.frame for each in sightings), LEAST_IOU)
    return Tally(found, sum(each.detected for each in sightings))


Overlap = Callable[[Sequence[Seen], Sequence[Detection]], Floats]
"""Tells how well each object and each detection lie on each other, objects x detections."""


def sighting(seen: Sequence[Seen], detections: Sequence[Detection], overlaps: Overlap) -> Sighting:
    """Compare a frame with what was found in it; every detection has a mask."""
    asked = [each for each in seen if each.asked_for]
    overlap = overlaps(asked, detections)
    tracked = np.array([each.track is not None for each in detections], np.bool_)
    matched = {column for _, column in assigned(np.where(tracked, _close(overlap), 0.0))}
    others = mask_overlap([each for each in seen if not each.asked_for], detections, regions=True)
    ignored = np.any(_close(others), axis=0).tolist()
    counted = [n for n in np.flatnonzero(tracked).tolist() if n in matched or not ignored[n]]
    tracks = [track for n in counted if (track := detections[n].track) is not None]
    frame = Frame([each.identity for each in asked], tracks, overlap[:, counted])
    return Sighting(frame, len(assigned(_close(overlap))))


def _close(overlap: Floats) -> Floats:
    return np.where(overlap >= LEAST_IOU, overlap, 0.0)


def mask_overlap(seen: Sequence[Seen], detections: Sequence[Detection], *, regions: bool = False) -> Floats:
    """Return the IoU of masks of the same class; of regions the share of each detection's mask on each of them."""
    found, true = ([_rle(each) for each in some] for some in (detections, seen))
    return _overlap(seen, detections, found, true, regions=regions)


def box_overlap(seen: Sequence[Seen], detections: Sequence[Detection]) -> Floats:
    """Return the IoU of boxes of the same class."""
    true = [coco.toBbox(_rle(each)) for each in seen]
    found = [[each.box.x1, each.box.y1, each.box.x2 - each.box.x1, each.box.y2 - each.box.y1] for each in detections]
    return _overlap(seen, detections, np.array(found, np.float64), np.array(true, np.float64), regions=False)


def _overlap(seen: Sequence[Seen], detections: Sequence[Detection], found: Any, true: Any, *, regions: bool) -> Floats:
    """Return objects x detections. found, true: their masks or boxes, as pycocotools takes them."""
    if not seen or not detections:
        return np.zeros((len(seen), len(detections)))
    overlap = coco.iou(found, true, [int(regions)] * len(seen))
    same = np.array([[each.name == other.name for other in detections] for each in seen])
    return np.where(same, np.asarray(overlap, np.float64).T, 0.0)


def _rle(each: Seen | Detection) -> dict[str, Any]:
    assert each.mask is not None  # noqa: S101 - a model that segments gives every object one
    return {"size": list(each.mask.size), "counts": each.mask.counts}
