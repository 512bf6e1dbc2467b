"""Colour and depth of one camera: whether a pixel of one is a pixel of the other. Pure.

Judged by sizes, frames, calibrations and stamps, not by what the pixels show.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from statistics import median
from typing import Final

from gateway.doctor.evidence import Evidence
from gateway.doctor.finding import Finding, Stage, fine, note, problem
from gateway.doctor.frames import connected
from schemas.camera_info import CameraInfo
from schemas.image import ImageFrame
from schemas.keys import Stream, StreamKey
from schemas.transforms import Transforms

TF_STATIC: Final = "tf_static"
SAME_K: Final = 1e-3
"""Focal lengths and centres, in pixels, that differ by less are equal."""


def check_cameras(evidence: Evidence) -> Iterator[Finding]:
    """Say of every camera what its calibration, and its depth, are good for."""
    keys = [each.key for each in evidence.streams if isinstance(each.key, StreamKey)]
    for camera in dict.fromkeys(key.camera.camera for key in keys):
        streams = {key.stream for key in keys if key.camera.camera == camera}
        if streams != {Stream.COLOR}:
            yield from _check_calibration(camera, Stream.COLOR, Stream.INFO, evidence)
        if evidence.of(camera, Stream.DEPTH_INFO):
            yield from _check_calibration(camera, Stream.DEPTH, Stream.DEPTH_INFO, evidence)
        if {Stream.COLOR, Stream.DEPTH} <= streams:
            yield from _check_alignment(camera, evidence)
            yield from _check_instants(camera, evidence)


def _info(camera: str, stream: Stream, evidence: Evidence) -> CameraInfo | None:
    look = evidence.of(camera, stream)
    return look.heard.message if look and isinstance(look.heard.message, CameraInfo) else None


def _image(camera: str, stream: Stream, evidence: Evidence) -> ImageFrame | None:
    look = evidence.of(camera, stream)
    return look.heard.message if look and isinstance(look.heard.message, ImageFrame) else None


def _check_calibration(camera: str, of: Stream, stream: Stream, evidence: Evidence) -> Iterator[Finding]:
    info, image = _info(camera, stream, evidence), _image(camera, of, evidence)
    if info is None:
        yield _without_calibration(camera, stream, evidence)
        return
    subject = f"{camera}/{stream}"
    if not (info.k[0] > 0 and info.k[4] > 0):
        yield problem(
            Stage.CAMERAS,
            subject,
            "the camera info has no focal length: the camera is not calibrated, so nothing can be measured with it",
            "calibrate it (`rosrun camera_calibration cameracalibrator.py`) or have the driver load its calibration",
        )
    elif not evidence.is_mapped(camera, stream):
        topic = getattr(evidence.of(camera, stream), "topic", "")
        yield note(
            Stage.CAMERAS,
            subject,
            f"{topic} has the calibration but is no stream, so distances cannot be measured off the robot",
            f"add --topics {subject}={topic}",
        )
    if image is not None and _sent_size(info) != _size(image):
        yield problem(
            Stage.CAMERAS,
            subject,
            f"the camera info is for {_by(_sent_size(info))} pixels, {of} has {_by(_size(image))}",
            "have the driver publish the calibration of the resolution it sends",
        )


def _without_calibration(camera: str, stream: Stream, evidence: Evidence) -> Finding:
    subject, look = f"{camera}/{stream}", evidence.of(camera, stream)
    if look is not None and look.publishers:
        return problem(
            Stage.CAMERAS, subject, f"no camera info could be read from {look.topic}", "see what sensors say above"
        )
    return note(
        Stage.CAMERAS,
        subject,
        "no camera info: what a pixel of depth means in space is unknown",
        f"have the driver publish camera_info, and add --topics {subject}=TOPIC",
    )


def _sent_size(info: CameraInfo) -> tuple[int, int]:
    """Return width and height of the picture that the camera sends, after its region and its binning."""
    width, height = (
        (info.roi.width, info.roi.height) if info.roi.width and info.roi.height else (info.width, info.height)
    )
    return width // max(info.binning_x, 1), height // max(info.binning_y, 1)


def _size(image: ImageFrame) -> tuple[int, int]:
    return image.width, image.height


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def _check_alignment(camera: str, evidence: Evidence) -> Iterator[Finding]:
    color, depth = _image(camera, Stream.COLOR, evidence), _image(camera, Stream.DEPTH, evidence)
    if color is None or depth is None:
        return
    info, depth_info = _info(camera, Stream.INFO, evidence), _info(camera, Stream.DEPTH_INFO, evidence)
    frames = (color.header.frame_id, depth.header.frame_id)
    apart = _apart(color, depth)
    if info is not None and depth_info is not None and not _infos_differ(info, depth_info):
        if apart:
            yield problem(
                Stage.CAMERAS,
                f"{camera}/depth",
                f"not aligned with colour though their camera infos say so: {apart}",
                "have the driver register depth to colour (align_depth, depth_registration), or publish depth's own "
                "camera info: distances are wrong until then",
            )
        else:
            yield fine(Stage.CAMERAS, f"{camera}/depth", "registered to colour, by camera infos, sizes and frames")
        return
    what = apart or (_infos_differ(info, depth_info) if info and depth_info else "")
    if what:
        yield from _unregistered(camera, what, frames, evidence)
    else:
        yield note(
            Stage.CAMERAS,
            f"{camera}/depth",
            "sizes and frames are those of colour; without both camera infos it is unknown whether they are aligned",
            f"publish depth's camera info, and add --topics {camera}/depth_info=TOPIC",
        )


def _apart(color: ImageFrame, depth: ImageFrame) -> str:
    """Return how the images themselves differ, or nothing."""
    if _size(color) != _size(depth):
        return f"colour has {_by(_size(color))} pixels, depth {_by(_size(depth))}"
    if color.header.frame_id != depth.header.frame_id:
        return f"colour is in frame {color.header.frame_id!r}, depth in {depth.header.frame_id!r}"
    return ""


def _infos_differ(info: CameraInfo, depth_info: CameraInfo) -> str:
    """Return in what the calibrations differ, or nothing."""
    if _sent_size(info) != _sent_size(depth_info):
        return f"camera infos of {_by(_sent_size(info))} and {_by(_sent_size(depth_info))} pixels"
    if any(abs(ours - theirs) > SAME_K for ours, theirs in zip(info.k, depth_info.k, strict=True)):
        return f"camera infos with other lenses (focal lengths {info.k[0]:.1f} and {depth_info.k[0]:.1f} pixels)"
    if info.header.frame_id != depth_info.header.frame_id:
        return f"camera infos in frames {info.header.frame_id!r} and {depth_info.header.frame_id!r}"
    return ""


def _unregistered(camera: str, what: str, frames: tuple[str, str], evidence: Evidence) -> Iterator[Finding]:
    """Depth has a view of its own: whoever measures with it has to turn it into colour's."""
    subject = f"{camera}/depth"
    if frames[0] == frames[1] or connected(_static_links(evidence), *frames):
        yield note(
            Stage.CAMERAS,
            subject,
            f"not registered to colour ({what}): whoever measures has to do it, by the calibrations and tf_static",
            "registering in the driver (align_depth, depth_registration) is exact and costs the robot less",
        )
    else:
        yield problem(
            Stage.CAMERAS,
            subject,
            f"not registered to colour ({what}), and tf_static does not connect {frames[0]!r} and {frames[1]!r}: "
            "depth cannot be laid over colour",
            "have the driver register depth to colour, or publish the static transform between the two frames",
        )


def _static_links(evidence: Evidence) -> Iterable[tuple[str, str]]:
    look = evidence.named(TF_STATIC)
    messages = [each.heard.message for each in look.publishers] if look else []
    for message in messages:
        if isinstance(message, Transforms):
            yield from ((each.frame_id, each.child_frame_id) for each in message.transforms)


def _check_instants(camera: str, evidence: Evidence) -> Iterator[Finding]:
    looks = [evidence.of(camera, stream) for stream in (Stream.COLOR, Stream.DEPTH)]
    color, depth = (sorted(look.heard.stamps_ns) if look else [] for look in looks)
    if len(color) < 2 or len(depth) < 2:
        return
    apart_ns = min(abs(one - other) for one in color for other in depth)
    period_ns = max(_period(color), _period(depth))
    if 2 * apart_ns > period_ns:
        yield problem(
            Stage.CAMERAS,
            f"{camera}/depth",
            f"stamps of colour and depth never come within half a frame of each other (at best {apart_ns / 1e6:.0f} ms,"
            f" a frame is {period_ns / 1e6:.0f} ms): they cannot be matched",
            "have one driver publish both, synchronised, or let both use the same clock",
        )


def _period(stamps: list[int]) -> float:
    return median(later - earlier for earlier, later in pairwise(stamps))
