"""What is followed on drives against what is truly there: which tracks lie on which objects.

Objects asked for, and ignore regions, are those of the average precision (see `precision`): a track's detection that is
not the match of an object asked for, and lies on another object of its class with at least `LEAST_IOU` of itself, is
neither right nor wrong, and that object is not missed. What has no track is not followed.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from pycocotools import mask as coco

from benchmarks.accuracy.drives import HZ, HeldOutDrive, Seen
from benchmarks.accuracy.identities import Floats, Frame, Identities, assigned, identities
from schemas.detections import Detection
from services.toolbox.train.inference import Follow

LEAST_IOU: Final = 0.5


@dataclass(frozen=True, slots=True)
class Followed:
    """Sums over drives. detected: the object-frames asked for that any detection, tracked or not, lies on."""

    identities: Identities
    detected: int
    frames: int


def followed(drives: Iterable[HeldOutDrive], follow: Follow, report: Callable[[int], None]) -> Followed:
    """Show each drive to `follow`, and report how many are done."""
    total, detected, frames = Identities(), 0, 0
    for done, drive in enumerate(drives, start=1):
        found = follow((frame.image() for frame in drive.frames), HZ)
        sightings = [sighting(frame.seen, each) for frame, each in zip(drive.frames, found, strict=True)]
        total += identities((each.frame for each in sightings), LEAST_IOU)
        detected += sum(each.detected for each in sightings)
        frames += len(sightings)
        report(done)
    return Followed(total, detected, frames)


@dataclass(frozen=True, slots=True)
class Sighting:
    """A frame's tracks among its objects, and how many of these any detection, tracked or not, lies on."""

    frame: Frame
    detected: int


def sighting(seen: Sequence[Seen], detections: Sequence[Detection]) -> Sighting:
    """Compare a frame with what was found in it; every detection has a mask."""
    asked = [each for each in seen if each.asked_for]
    overlap = _overlap(asked, detections, regions=False)
    tracked = np.array([each.track is not None for each in detections], np.bool_)
    matched = {column for _, column in assigned(np.where(tracked, _close(overlap), 0.0))}
    others = _overlap([each for each in seen if not each.asked_for], detections, regions=True)
    ignored = np.any(_close(others), axis=0).tolist()
    counted = [n for n in np.flatnonzero(tracked).tolist() if n in matched or not ignored[n]]
    tracks = [track for n in counted if (track := detections[n].track) is not None]
    frame = Frame([each.identity for each in asked], tracks, overlap[:, counted])
    return Sighting(frame, len(assigned(_close(overlap))))


def _close(overlap: Floats) -> Floats:
    return np.where(overlap >= LEAST_IOU, overlap, 0.0)


def _overlap(seen: Sequence[Seen], detections: Sequence[Detection], *, regions: bool) -> Floats:
    """Return objects x detections: the IoU of masks of the same class; of regions the share of the detection on it."""
    if not seen or not detections:
        return np.zeros((len(seen), len(detections)))
    found = coco.iou([_rle(each) for each in detections], [_rle(each) for each in seen], [int(regions)] * len(seen))
    same = np.array([[each.name == found.name for found in detections] for each in seen])
    return np.where(same, np.asarray(found, np.float64).T, 0.0)


def _rle(each: Seen | Detection) -> dict[str, Any]:
    assert each.mask is not None  # noqa: S101 - a model that segments gives every object one
    return {"size": list(each.mask.size), "counts": each.mask.counts}
