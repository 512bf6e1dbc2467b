"""Reads from a topic's name which camera it belongs to, and which of its images it is."""

import re
from dataclasses import dataclass
from itertools import groupby
from typing import Final

Path = tuple[str, ...]
"""Chunks of a camera's namespace."""

COLORS: Final = frozenset({"color", "colour", "rgb", "bgr"})
GREYS: Final = frozenset({"mono", "gray", "grey"})
INFRAREDS: Final = frozenset({"ir", "ir2", "infra", "infra1", "infra2", "infrared"})
DEPTHS: Final = frozenset({"depth"})
IMAGES: Final = frozenset({"image", "img"}) | COLORS | GREYS | INFRAREDS | DEPTHS
POINTS: Final = frozenset({"points", "points2", "point", "cloud", "pointcloud"})
DISPARITIES: Final = frozenset({"disparity"})
TO: Final = "to"

WORDS: Final = (
    IMAGES | POINTS | DISPARITIES | {"raw", "rect", "registered", "aligned", "hw", "sw", "hd", "qhd", "sd", TO}
)
"""Words in the names of images; other words of a chunk are the camera's name."""

_MODALITIES: Final = COLORS | DEPTHS
_BEFORE_NAMES: Final = _MODALITIES | {"registered", "aligned", TO}
"""Words for a modality that may precede or split a camera's name: depth_front, front_depth_camera."""

RECTIFIED: Final = frozenset({"rect", "rectified"}) | DISPARITIES
"""Disparities belong to the left image of a rectified pair."""

DEVICES: Final = frozenset({"cam", "camera", "webcam", "lidar"})
"""Words that mark a last chunk as a camera with a single image."""

NO_PICTURE: Final = re.compile(
    "ambient|annot.*|confidence|costmap|debug|detect.*|extrinsics|features|filtered|fused|heatmap|intensity|keypoints|labels?"
    "|map|masks?|matches|nearir|normals|octomap|output|overlay|range|reflec.*|results?|segment.*|signal|tags?|track.*"
    "|visuali[sz].*|viz|voxel"
)
"""Words in the names of derived images and points, or of topics that look like images but are not."""


@dataclass(frozen=True, slots=True)
class Reading:
    """The parts of a topic's name.

    path: the camera. said: words of what is shown. onto: of what it is aligned to. leaf: the last chunk; empty where
    that is the camera.
    before: how many words stand between the camera and the leaf.
    """

    path: Path
    said: frozenset[str]
    onto: frozenset[str]
    leaf: str
    before: int


def says_rectified(name: str) -> bool:
    """Return whether an image's name says, by ROS's conventions, that it is rectified."""
    return not RECTIFIED.isdisjoint(re.split("[/_]", name.lower()))


def read(name: str) -> Reading | None:
    """Return the parts of a topic's name, or None unless it is a camera's."""
    chunks = name.strip("/").split("/")
    if any(NO_PICTURE.fullmatch(word) for chunk in chunks for word in chunk.lower().split("_")):
        return None
    leaf = chunks[-1]
    if not _split(leaf)[1]:
        return _device(chunks)
    found: list[list[str]] = []
    rest = ""
    while chunks and not rest:
        rest, words = _split(chunks.pop())
        found.append(words)
    path, before_names = _without_modalities([*chunks, rest] if rest else [])
    said, onto = _directed([*found, *before_names])
    return Reading(path, said, onto, leaf, sum(len(words) for words in found[1:]))


def _device(chunks: list[str]) -> Reading | None:
    if not DEVICES & {word.rstrip("0123456789") for word in chunks[-1].lower().split("_")}:
        return None
    path, words = _without_modalities(chunks)
    return Reading(path, *_directed(words), "", 0)


def _without_modalities(chunks: list[str]) -> tuple[Path, list[list[str]]]:
    """Return a camera's namespace without modality words, and those words."""
    path, words = [], []
    for chunk in chunks:
        kept: list[str] = []
        for is_word, parts in groupby(chunk.split("_"), lambda part: part.lower() in _BEFORE_NAMES):
            run = list(parts)
            if is_word and _MODALITIES & {part.lower() for part in run}:
                words.append([part.lower() for part in run])
            else:
                kept += run
        if rest := "_".join(kept).strip("_"):
            path.append(rest)
    return tuple(path), words


def _split(chunk: str) -> tuple[str, list[str]]:
    """Return the part before the last image words, and those words."""
    parts = chunk.split("_")
    at = len(parts)
    while at and parts[at - 1].lower() in WORDS:
        at -= 1
    return "_".join(parts[:at]).strip("_"), [part.lower() for part in parts[at:]]


def _directed(found: list[list[str]]) -> tuple[frozenset[str], frozenset[str]]:
    said: set[str] = set()
    onto: set[str] = set()
    for words in found:
        at = words.index(TO) if TO in words else len(words)
        said.update(words[:at])
        onto.update(words[at + 1 :])
    return frozenset(said), frozenset(onto)
