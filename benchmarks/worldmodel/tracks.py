"""Names the tracks of single cameras by the objects of a world model that sees what the camera sees.

A track is another one where an object was hidden for long, or left the image: the world model knows it by its place.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

import msgspec

from benchmarks.accuracy.drives import HZ, SENSORS, HeldOutDrive
from benchmarks.accuracy.following import Followed, followed
from benchmarks.worldmodel.drives import World
from benchmarks.worldmodel.recording import CAMERA, RecordedImage
from benchmarks.worldmodel.replay import ReplayedCamera
from schemas.detections import Detection, Detections
from schemas.distances import CameraView
from schemas.header import Header
from services.simulator.localisation import Drift, Localisation
from services.toolbox.train.inference import Follow

NEAR_S: Final = 5.0
"""A track goes by the object that its detections within this time belong to; those nearer in time count for more."""

Found = Sequence[Sequence[Detection]]
"""The detections of each image of a drive."""


def scores_by_place(
    drives: Iterable[HeldOutDrive], follow: Follow, drift: Drift, report: Callable[[int], None]
) -> dict[str, Any]:
    """Return how well tracks keep their identities, as a tracker numbers them and by the ids of the world model."""
    kept = list(drives)
    found: list[Found] = []

    def tracks(images: Iterable[Any], hz: float) -> Found:
        found.append(follow(images, hz))
        return found[-1]

    by_tracker = followed(kept, tracks, report)
    named = iter([named_by_place(drive, each, drift) for drive, each in zip(kept, found, strict=True)])
    by_place = followed(kept, lambda *_: next(named), lambda _: None)
    return {**_figures("by_place", by_place), **_figures("by_tracker", by_tracker)}


def _figures(how: str, scores: Followed) -> dict[str, Any]:
    made: dict[str, Any] = {}
    for end, tally in (("", scores.boxes), ("_masks", scores.masks)):
        idf1 = tally.identities.idf1
        made[f"idf1_{how}{end}"] = None if idf1 is None else round(idf1, 4)
        made[f"id_switches_{how}{end}"] = tally.identities.switches
    return made


def named_by_place(drive: HeldOutDrive, found: Found, drift: Drift) -> Found:
    """Return the detections with tracks by the objects that they belong to; those of no object keep their own."""
    ids = _belonging(drive, found, drift)
    votes: dict[int, list[tuple[int, int]]] = {}
    for number, (detections, of) in enumerate(zip(found, ids, strict=True)):
        for index, each in enumerate(detections):
            if each.track is not None and index in of:
                votes.setdefault(each.track, []).append((number, of[index]))
    numbers: dict[tuple[str, int], int] = {}
    return [named(detections, number, votes, numbers) for number, detections in enumerate(found)]


def _belonging(drive: HeldOutDrive, found: Found, drift: Drift) -> Sequence[Mapping[int, int]]:
    """Return each image's objects by the index of their detection: those that are published at some time."""
    ids: list[Mapping[int, int]] = []

    def identify(_: CameraView, numbers: Mapping[int, int]) -> None:
        ids.append(numbers)

    world, camera, errors = World(identify), ReplayedCamera(), Localisation(drift, [], (drive.seed, 0))
    last: dict[int, int] = {}
    for seq, (frame, objects) in enumerate(zip(drive.frames, found, strict=True)):
        header = Header(robot="r1", camera=CAMERA, boot_id="", seq=seq, stamp_ns=0, frame_id=CAMERA, received_ns=0)
        sensed = SENSORS.color
        seen = Detections(
            header=header, height=sensed.height, width=sensed.width, objects=list(objects), model="", worker=""
        )
        image = RecordedImage(detections=seen, depth_png=frame.depth_png, pose=frame.pose, visible=[], shown=[])
        for event in world.events(camera.messages(image, seq / HZ, seq, errors.error(seq / HZ))):
            last.setdefault(event.number, event.number)
            if event.into is not None:
                last = {number: event.into if now == event.number else now for number, now in last.items()}
    return [{index: last[number] for index, number in of.items() if number in last} for of in ids]


def named(
    detections: Sequence[Detection],
    number: int,
    votes: Mapping[int, Sequence[tuple[int, int]]],
    numbers: dict[tuple[str, int], int],
) -> Sequence[Detection]:
    """Return an image's detections with new tracks: each object is given to the one with most votes for it.

    number: of the image. votes: by track, the image and the object of each of its detections. numbers: of the new
    tracks.
    """
    near = NEAR_S * HZ + 1
    counted = []
    for index, each in enumerate(detections):
        of = defaultdict[int, float](float)
        for at, id_ in () if each.track is None else votes.get(each.track, ()):
            of[id_] += max(0.0, 1 - abs(at - number) / near)
        counted += [(vote, index, id_) for id_, vote in of.items() if vote > 0]
    names: dict[int, tuple[str, int]] = {}
    for _, index, id_ in sorted(counted, reverse=True):
        if index not in names and ("object", id_) not in names.values():
            names[index] = ("object", id_)
    made = []
    for index, each in enumerate(detections):
        if each.track is None:
            made.append(each)
        else:
            name = names.get(index, ("track", each.track))
            made.append(msgspec.structs.replace(each, track=numbers.setdefault(name, len(numbers))))
    return made
