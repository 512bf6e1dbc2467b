"""Finds and ranks the topics that could be a camera's streams."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Final

from gateway.discovery.published_topics import Topic, image_of
from gateway.discovery.topic_names import (
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
from gateway.node_names import ros_chunk
from gateway.ros1 import image as ros_image
from gateway.ros1 import point_cloud as ros_point_cloud
from gateway.to_bus.translators import images
from schemas.image import DEPTH_ENCODINGS
from schemas.keys import RESERVED, Stream

LEAVES: Final = ("image_raw", "points", "image_color", "image", "image_rect_color", "image_rect_raw", "image_rect")
"""Names of image topics, the preferred one first where they show the same."""

_GREY: Final = 2

Rank = tuple[int, int, int, int, str]
"""Sort key of a candidate; lower is better."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A topic that could be a camera's stream."""

    rank: Rank
    topic: Topic
    path: Path
    stream: Stream


def image_candidate(topic: Topic) -> Candidate | None:
    """Return the candidate for an image topic, raw or compressed; None unless named like a camera's.

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
    """Return whether neither name nor known encoding tells if an image is colour or depth."""
    if topic.encoding or READERS.get(topic.type) is not image_candidate:
        return False
    found = _read(topic, IMAGES)
    return found is not None and not found.said & (COLORS | GREYS | DEPTHS)


def points_candidate(topic: Topic) -> Candidate | None:
    """Return the candidate for a point cloud topic; None unless named like a camera's or lidar's."""
    found = _read(topic, POINTS)
    if found is None:
        return None
    return _candidate(topic, found, Stream.POINTS, 0 if found.said & (COLORS | {"registered"}) else 1)


def shows_colors(points: str) -> bool:
    """Return whether a point cloud's name says that it is a depth camera's with colours."""
    found = read(points)
    return found is not None and (bool(found.said & COLORS) or found.said >= DEPTHS | {"registered"})


def is_rectified_color(candidate: Candidate) -> bool:
    """Return whether a colour candidate is a rectified colour or grey image in its own sensor's view."""
    return candidate.rank[1] <= _GREY and says_rectified(candidate.topic.name)


def disparity_candidate(topic: Topic) -> Candidate | None:
    """Return the candidate for a disparity topic, used as depth where there is none; None unless named so."""
    found = _read(topic, DISPARITIES)
    return None if found is None else _candidate(topic, found, Stream.DEPTH, 3)


READERS: Final[Mapping[str, Callable[[Topic], Candidate | None]]] = {
    ros_image.TYPE_NAME: image_candidate,
    images.COMPRESSED_TYPE: image_candidate,
    images.DISPARITY_TYPE: disparity_candidate,
    ros_point_cloud.TYPE_NAME: points_candidate,
}
"""Candidate functions by ROS type."""


def one_of_each_image(topics: Iterable[Topic]) -> tuple[list[Topic], dict[str, str]]:
    """Return the topics without other forms of the same image, and by left-out topic the one that is kept.

    The raw form is kept where there is one. An image's `compressedDepth` is one of depth alone: image_transport
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


SIDES: Final = ("left", "stereo", "right")
"""Last namespace chunks of a stereo camera's sides, if the rest is a camera too; the preferred one first."""


def with_sides_joined(candidates: Sequence[Candidate], given: Mapping[Path, str]) -> list[Candidate]:
    """Return the candidates with both sides of a stereo camera as one camera.

    Sides without a common camera are two cameras and stay so. given: cameras that already have a name.
    """
    whole = {candidate.path for candidate in candidates} | given.keys()
    return [_joined(candidate, whole, given) for candidate in candidates]


def _joined(candidate: Candidate, whole: Iterable[Path], given: Mapping[Path, str]) -> Candidate:
    *parent, side = candidate.path or ("",)
    if side not in SIDES or tuple(parent) not in whole or candidate.path in given:
        return candidate
    return replace(candidate, path=tuple(parent), rank=(1 + SIDES.index(side), *candidate.rank[1:]))


def rectified_first(colors: Sequence[Candidate]) -> list[Candidate]:
    """Return a camera's colour candidates, rectified ones of the preferred side first."""
    side = colors[0].rank[0]
    return sorted(colors, key=lambda each: not (each.rank[0] == side and is_rectified_color(each)))


def best(candidates: Iterable[Candidate], names: Mapping[Path, str]) -> dict[tuple[str, Stream], list[Candidate]]:
    """Return the candidates by camera and stream, the preferred one first."""
    slots: dict[tuple[str, Stream], list[Candidate]] = {}
    for candidate in sorted(candidates, key=lambda each: each.rank):
        slots.setdefault((names[candidate.path], candidate.stream), []).append(candidate)
    return dict(sorted(slots.items()))


UNNAMED: Final = "camera"
MAX_NAME: Final = 64


def name_cameras(paths: Iterable[Path], robot: str, given: Mapping[Path, str], taken: Iterable[str]) -> dict[Path, str]:
    """Return the name of every camera; those in `given` keep theirs, names in `taken` are not used.

    A name is the end of the camera's namespace, as much of it as tells it from the others. Of two names that ROS could
    not tell apart one gets a number.
    """
    names = dict(given)
    stems = {path: _stem(path, robot) for path in {*paths, *given}}
    tail = 0 if given else _common_tail(list(stems.values()))
    telling = {path: stem[: len(stem) - tail] for path, stem in stems.items()}
    ends = Counter(end for stem in telling.values() for end in _ends(stem))
    taken_on_ros = {ros_chunk(name) for name in (*given.values(), *taken)}
    for path in sorted(stems.keys() - names.keys(), key=lambda path: (len(path), path)):
        proposals = _proposals(path, telling[path], ends)
        names[path] = next(name for name in proposals if ros_chunk(name) not in taken_on_ros)
        taken_on_ros.add(ros_chunk(names[path]))
    return names


def _stem(path: Path, robot: str) -> Path:
    """Return the namespace without the robot's, and without a node's that repeats its parent, like zed/zed_node."""
    chunks = path[1:] if len(path) > 1 and path[0] == ros_chunk(robot) else path
    if len(chunks) > 1 and chunks[-1] == f"{chunks[-2]}_node":
        chunks = chunks[:-1]
    return chunks or (UNNAMED,)


def _common_tail(stems: Collection[Path]) -> int:
    """Return the number of last chunks that all cameras share."""
    distinct = set(stems)
    if len(distinct) < 2:
        return 0
    longest = min(len(stem) for stem in distinct) - 1
    return next((n for n in range(longest, 0, -1) if len({stem[-n:] for stem in distinct}) == 1), 0)


def _ends(stem: Path) -> Iterator[Path]:
    """Return the suffixes of a path, the shortest first, the path itself last."""
    return (stem[-length:] for length in range(1, len(stem) + 1))


def _proposals(path: Path, stem: Path, ends: Mapping[Path, int]) -> Iterator[str]:
    yield from (_legal(end) for end in _ends(stem) if ends[end] == 1)
    yield from (_legal(stem), _legal(path))
    for number in count(2):
        yield f"{_legal(path)[: MAX_NAME - 6]}_{number}"


def _legal(chunks: Path) -> str:
    name = "_".join(chunks).strip("_")[:MAX_NAME] or UNNAMED
    return f"{name}_{UNNAMED}" if name in RESERVED else name
