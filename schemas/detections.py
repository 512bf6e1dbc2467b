"""Detections: the objects that one model call found in one image."""

from typing import Annotated, Final

import msgspec

from schemas.errors import SchemaError
from schemas.header import Header, Label, Spans
from schemas.image import MAX_SIDE, Side

MAX_DETECTIONS: Final = 1_000

KEPT_LISTS: Final = 100
"""Class lists of a camera kept by publishers for receivers whose link was cut: 10 seconds at 10 Hz."""

TRACK_COUNT_BITS: Final = 20
"""Number of low bits of a track number that count objects from 1; the bits above belong to a tracker."""

Index = Annotated[int, msgspec.Meta(ge=0, lt=MAX_DETECTIONS)]
TrackNumber = Annotated[int, msgspec.Meta(ge=0, lt=2**53)]
ClassNumber = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]

MAX_KEYPOINTS: Final = 256

IN_VIEW: Final = 0.5
"""Score from which on a keypoint counts as in view."""

Edge = Annotated[float, msgspec.Meta(ge=0, le=MAX_SIDE)]


class Box(msgspec.Struct, frozen=True):
    """Corners of an upright rectangle in pixels of the image; (0, 0) is the outer corner of the first pixel.

    >>> box = fleetsight.Box(100, 50, 260, 170)
    >>> (box.x2 - box.x1, box.y2 - box.y1)  # width and height
    (160, 120)
    """

    x1: Edge
    y1: Edge
    x2: Edge
    y2: Edge


class Mask(msgspec.Struct, frozen=True):
    """A COCO run-length mask in the image's own resolution, as pycocotools reads and writes it.

    size: (height, width) in pixels. counts: the compressed runs. quality: how good whoever made it expects it to be, as
    IoU with the true mask, 0 if there is no such object; absent where that is not judged.

    >>> mask = fleetsight.Mask(size=(2, 3), counts="6")  # the runs: 6 pixels without the object
    >>> height, width = mask.size
    """

    size: tuple[Side, Side]
    counts: Annotated[str, msgspec.Meta(max_length=1_000_000)]
    quality: Annotated[float, msgspec.Meta(ge=0, le=1)] | None = None


Anywhere = Annotated[float, msgspec.Meta(ge=-MAX_SIDE, le=2 * MAX_SIDE)]


class RotatedBox(msgspec.Struct, frozen=True):
    """A rectangle that is turned, in pixels of the image, beyond whose borders it may reach.

    x, y: its middle. width, height: of its sides. angle: from the image's x axis to the side that `width` is of, in
    radians, clockwise as seen. The same as Ultralytics' `xywhr`.
    """

    x: Anywhere
    y: Anywhere
    width: Annotated[float, msgspec.Meta(ge=0, le=2 * MAX_SIDE)]
    height: Annotated[float, msgspec.Meta(ge=0, le=2 * MAX_SIDE)]
    angle: Annotated[float, msgspec.Meta(ge=-7, le=7)]


class Keypoint(msgspec.Struct, frozen=True, gc=False):
    """One of an object's keypoints in pixels of the image; score: how sure the model is that it is in view, 0 to 1."""

    x: Edge
    y: Edge
    score: Annotated[float, msgspec.Meta(ge=0, le=1)]


class Detection(msgspec.Struct, frozen=True, kw_only=True):
    """One object.

    score: confidence, 0 to 1. label: the model's own number of the class.
    box: of a rotated box, the upright one around what of it is in the image; of a class of the whole image, all of it.
    mask: absent when the model does not segment, when nobody wanted masks as the frame went to the model, and of an
    object that the model for masks did not find.
    track: equal in the frames of a camera that show the same object; no two objects ever share one, whatever
    their camera. Its lowest TRACK_COUNT_BITS bits count from 1. Absent while nothing is tracked, and of an object that
    has not been seen often or surely enough to be followed.
    rotated: of a model for rotated boxes, whose masks they are. keypoints: of a model for poses, as many and in the
    order that it was trained with, mostly COCO's 17 of people.

    >>> found = fleetsight.Detection(name="pallet", score=0.9, box=fleetsight.Box(100, 50, 260, 170))
    >>> found.mask is None and found.track is None
    True
    """

    name: Label
    score: Annotated[float, msgspec.Meta(ge=0, le=1)]
    box: Box
    mask: Mask | None = None
    label: ClassNumber = 0
    track: TrackNumber | None = None
    rotated: RotatedBox | None = None
    keypoints: Annotated[list[Keypoint], msgspec.Meta(max_length=MAX_KEYPOINTS)] | None = None


class Detections(msgspec.Struct, frozen=True, kw_only=True):
    """The objects in one image of height x width pixels, best score first, with model and worker.

    >>> box = fleetsight.Box(100, 50, 260, 170)
    >>> found = fleetsight.Detections(
    ...     header=header, height=480, width=640, model="my.pt", worker="w1",
    ...     objects=[fleetsight.Detection(name="pallet", score=0.9, box=box)],
    ... )
    >>> [(each.name, each.box.x1 / found.width) for each in found.objects]
    [('pallet', 0.15625)]
    """

    header: Header
    height: Side
    width: Side
    objects: Annotated[list[Detection], msgspec.Meta(max_length=MAX_DETECTIONS)]
    model: Label
    worker: Label
    spans: Spans = {}

    def __post_init__(self) -> None:
        """Check the masks' size against the image.

        Raises:
            SchemaError: a mask has another size than the image.
        """
        for found in self.objects:
            if found.mask is not None and found.mask.size != (self.height, self.width):
                raise SchemaError(f"mask of {found.mask.size} in an image of {(self.height, self.width)}")


class ClassCount(msgspec.Struct, frozen=True, gc=False):
    """The number of objects of one class in view, and the best score among them.

    >>> fleetsight.ClassCount("box", 3, 0.91).count
    3
    """

    name: Label
    count: Annotated[int, msgspec.Meta(ge=0, le=MAX_DETECTIONS)]
    score: Annotated[float, msgspec.Meta(ge=0, le=1)]


class ClassList(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """The classes in view of one camera at one frame, by name. An empty list is news too: nothing is in view.

    >>> classes = [fleetsight.ClassCount("box", 3, 0.91), fleetsight.ClassCount("forklift", 1, 0.7)]
    >>> seen = fleetsight.ClassList(header=header, classes=classes, model="my.pt", worker="w1")
    >>> {each.name: each.count for each in seen.classes}
    {'box': 3, 'forklift': 1}
    """

    header: Header
    classes: Annotated[list[ClassCount], msgspec.Meta(max_length=MAX_DETECTIONS)]
    model: Label
    worker: Label
    spans: Spans = {}


def class_list(detections: Detections) -> ClassList:
    """Count the objects of each class."""
    scores: dict[str, list[float]] = {}
    for found in detections.objects:
        scores.setdefault(found.name, []).append(found.score)
    return ClassList(
        header=detections.header,
        classes=[ClassCount(name, len(of), max(of)) for name, of in sorted(scores.items())],
        model=detections.model,
        worker=detections.worker,
        spans=detections.spans,
    )
