"""Checks that coordinate frames are connected, and cameras' frames among them. Pure."""

import difflib
from collections.abc import Iterable, Iterator
from typing import Final

from gateway.doctor.evidence import Evidence
from gateway.doctor.finding import Finding, Stage, note
from schemas.image import ImageFrame
from schemas.keys import TF, TF_STATIC, Stream, StreamKey
from schemas.points import PointCloud
from schemas.transforms import Transforms

BASES: Final = ("base_link", "base_footprint")
"""Usual names of a robot's base frame."""

_SEEN: Final = (Stream.COLOR, Stream.DEPTH, Stream.POINTS)
_MEASURED: Final = frozenset({Stream.DEPTH, Stream.POINTS})
_PLACED: Final = _MEASURED | {Stream.INFO}
"""Streams that give a camera's objects a position, if the robot measures distances."""


def links(evidence: Evidence) -> Iterator[tuple[str, str]]:
    """Yield parent and child frame of every transform received."""
    looks = [look for name in (TF, TF_STATIC) if (look := evidence.named(name))]
    for message in (message for look in looks for each in look.publishers for message in each.heard.messages):
        if isinstance(message, Transforms):
            yield from ((bare(each.frame_id), bare(each.child_frame_id)) for each in message.transforms)


def connected(links: Iterable[tuple[str, str]], one: str, other: str) -> bool:
    """Return whether links, each a pair of frame names, connect one frame with the other.

    Older drivers write a slash before a frame's name; it means nothing.
    """
    neighbours: dict[str, set[str]] = {}
    for parent, child in links:
        neighbours.setdefault(bare(parent), set()).add(bare(child))
        neighbours.setdefault(bare(child), set()).add(bare(parent))
    seen, ahead = {bare(one)}, [bare(one)]
    while ahead:
        new = neighbours.get(ahead.pop(), set()) - seen
        seen |= new
        ahead += new
    return bare(other) in seen


def bare(frame: str) -> str:
    """Return a frame's name without the leading slash of older drivers."""
    return frame.removeprefix("/")


def check_frames(evidence: Evidence) -> Iterator[Finding]:
    """Check for every camera that locates objects whether transforms connect it to the robot."""
    if evidence.master.graph is None:
        return
    keys = [each.key for each in evidence.streams if isinstance(each.key, StreamKey)]
    cameras = dict.fromkeys(key.camera.camera for key in keys if key.stream in _PLACED)
    if not any(key.stream in _MEASURED for key in keys):
        return
    known = set(links(evidence))
    if cameras and not known:
        yield note(
            Stage.CAMERAS,
            evidence.robot,
            f"no transforms came on /{TF} or /{TF_STATIC}: objects are placed before their camera, but neither on the "
            "robot nor on the map",
            "start robot_state_publisher with the robot's URDF, or publish where each camera is, in metres and "
            f"radians: `{_publisher(BASES[0], 'CAMERA_FRAME')}`",
        )
        return
    for camera in cameras:
        for frame in _frames_of(camera, evidence):
            yield from _check_frame(camera, frame, known, evidence)


def _frames_of(camera: str, evidence: Evidence) -> list[str]:
    """Return the frames of a camera's images and points."""
    looks = [look for stream in _SEEN if (look := evidence.of(camera, stream))]
    messages = (message for look in looks for each in look.publishers for message in each.heard.messages)
    frames = (bare(each.header.frame_id) for each in messages if isinstance(each, ImageFrame | PointCloud))
    return list(dict.fromkeys(frames))


def _check_frame(camera: str, frame: str, known: set[tuple[str, str]], evidence: Evidence) -> Iterator[Finding]:
    if not frame:
        what = "its images or points are in no frame: header.frame_id is empty"
        yield note(Stage.CAMERAS, camera, what, "have the driver fill it (its parameter is mostly called frame_id)")
        return
    names = {name for link in known for name in link}
    base = next((name for name in BASES if name in names), None)
    if frame not in names:
        close = difflib.get_close_matches(frame, sorted(names), n=1, cutoff=0.6)
        yield note(
            Stage.CAMERAS,
            camera,
            f"its frame {frame!r} is in no transform that came in {evidence.seconds:g} s",
            (f"is it {close[0]!r} there? Then set the driver's frame_id to that; if not, " if close else "")
            + f"publish where it is, in metres and radians: `{_publisher(base or BASES[0], frame)}`",
        )
    elif base is not None and not connected(known, frame, base):
        yield note(
            Stage.CAMERAS,
            camera,
            f"no transform that came in {evidence.seconds:g} s leads from its frame {frame!r} to {base!r}",
            f"publish where the frame at the top of its own tree is, in metres and radians: "
            f"`{_publisher(base, _root(frame, known))}`",
        )


def _root(frame: str, known: set[tuple[str, str]]) -> str:
    """Return the root frame of a frame's tree."""
    parents = {child: parent for parent, child in known}
    seen = {frame}
    while (parent := parents.get(frame)) is not None and parent not in seen:
        frame = parent
        seen.add(frame)
    return frame


def _publisher(parent: str, child: str) -> str:
    return f"rosrun tf2_ros static_transform_publisher X Y Z YAW PITCH ROLL {parent} {child}"
