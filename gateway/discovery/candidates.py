"""Which topics could be which stream of which camera, and how well they would do."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from gateway.discovery.reading import (
    COLORS,
    DEPTHS,
    DISPARITIES,
    GREYS,
    IMAGES,
    INFRAREDS,
    POINTS,
    Path,
    Reading,
    read,
    says_rectified,
)
from gateway.discovery.topics import Topic, image_of
from gateway.ros1 import image as ros_image
from gateway.ros1 import point_cloud as ros_point_cloud
from gateway.translators import compressed_image, disparity
from schemas.image import DEPTH_ENCODINGS
from schemas.keys import Stream

LEAVES: Final = ("image_raw", "points", "image_color", "image", "image_rect_color", "image_rect_raw", "image_rect")
"""The names of pictures, the preferred one first where they show the same."""

_GREY: Final = 2

Rank = tuple[int, int, int, int, str]
"""Less is better."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A topic that could be a camera's stream."""

    rank: Rank
    topic: Topic
    path: Path
    stream: Stream


def image_candidate(topic: Topic) -> Candidate | None:
    """Read the name of an image, raw or compressed; None when it is not named like a camera's.

    Pixels that are distances are depth, whatever the name says; infrared ones of that encoding are neither.
    """
    found = _read(topic, IMAGES)
    if found is None:
        return None
    if found.said & DEPTHS or (topic.encoding in DEPTH_ENCODINGS and not found.said & INFRAREDS):
        return _candidate(topic, found, Stream.DEPTH, _alignment(found))
    if topic.encoding in DEPTH_ENCODINGS:
        return None
    if topic.name.endswith("/compressedDepth"):
        return None
    return _candidate(topic, found, Stream.COLOR, _modality(found))


def is_unclear(topic: Topic) -> bool:
    """Return whether an image's name does not say whether it is colour or depth, and its pixels are not known."""
    if topic.encoding or READERS.get(topic.type) is not image_candidate:
        return False
    found = _read(topic, IMAGES)
    return found is not None and not found.said & (COLORS | GREYS | DEPTHS)


def points_candidate(topic: Topic) -> Candidate | None:
    """Read the name of points; None when it is not named like a camera's or lidar's."""
    found = _read(topic, POINTS)
    if found is None:
        return None
    return _candidate(topic, found, Stream.POINTS, 0 if found.said & (COLORS | {"registered"}) else 1)


def shows_colors(points: str) -> bool:
    """Return whether the name of points says that they are a depth camera's with the colours of a picture."""
    found = read(points)
    return found is not None and (bool(found.said & COLORS) or found.said >= DEPTHS | {"registered"})


def is_rectified_color(candidate: Candidate) -> bool:
    """Return whether a candidate for colour is a rectified image in colour or grey, of no other sensor's view."""
    return candidate.rank[1] <= _GREY and says_rectified(candidate.topic.name)


def disparity_candidate(topic: Topic) -> Candidate | None:
    """Read the name of disparities, which are taken for depth where there is none."""
    found = _read(topic, DISPARITIES)
    return None if found is None else _candidate(topic, found, Stream.DEPTH, 3)


READERS: Final[Mapping[str, Callable[[Topic], Candidate | None]]] = {
    ros_image.TYPE_NAME: image_candidate,
    compressed_image.TYPE_NAME: image_candidate,
    disparity.TYPE_NAME: disparity_candidate,
    ros_point_cloud.TYPE_NAME: points_candidate,
}
"""By ROS type: what reads the names of its topics."""


def one_of_each_image(topics: Iterable[Topic]) -> tuple[list[Topic], dict[str, str]]:
    """Return the topics less those that are compressed forms of others, and by topic whose form those are.

    The raw form is taken where there is one. An image's `compressedDepth` is one of depth alone: image_transport
    advertises it for colour as well.
    """
    best: dict[str, Topic] = {}
    doubles: dict[str, str] = {}
    for topic in sorted(topics, key=lambda each: (_form(each), each)):
        first = best.setdefault(image_of(topic.name), topic)
        if first is not topic:
            doubles[topic.name] = first.name
    return list(best.values()), doubles


def _form(topic: Topic) -> int:
    if topic.name == image_of(topic.name):
        return 0
    found = read(image_of(topic.name))
    is_depth = found is not None and bool(found.said & DEPTHS)
    return 1 if is_depth == topic.name.endswith("/compressedDepth") else 2


def _read(topic: Topic, needed: frozenset[str]) -> Reading | None:
    found = read(image_of(topic.name))
    return found if found is not None and (not found.said or not found.leaf or found.said & needed) else None


def _candidate(topic: Topic, found: Reading, stream: Stream, kind: int) -> Candidate:
    leaf = LEAVES.index(found.leaf) if found.leaf in LEAVES else len(LEAVES)
    return Candidate((0, kind, found.before, leaf, topic.name), topic, found.path, stream)


def _alignment(found: Reading) -> int:
    """Rank depth: registered to colour, as measured, registered to something else."""
    if "registered" in found.said or found.onto & COLORS:
        return 0
    return 2 if found.onto else 1


def _modality(found: Reading) -> int:
    """Rank images: colour, unnamed, grey, infrared; those warped onto another sensor after all of them."""
    if found.onto:
        return 4
    if found.said & INFRAREDS:
        return 3
    if found.said & GREYS or ("rect" in found.said and not found.said & COLORS):
        return _GREY
    return 0 if found.said & COLORS else 1
