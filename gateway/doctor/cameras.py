"""Checks whether colour and depth of a camera are aligned pixel by pixel. Pure.

Judged by sizes, frames, calibrations and stamps, and by what the pixels show where that is clear.
"""

from collections.abc import Iterator
from itertools import pairwise
from statistics import median
from typing import Final

from gateway.doctor import advice
from gateway.doctor.calibration import by, calibration_of, check_calibration, image_of, pixels, sent_pixels
from gateway.doctor.depth_alignment import Placement, placement
from gateway.doctor.evidence import Evidence, StreamLook
from gateway.doctor.finding import Finding, Stage, fine, note, problem
from gateway.doctor.frames import connected, links
from schemas.camera_info import CameraInfo
from schemas.image import ImageFrame
from schemas.keys import TF, Stream, StreamKey

SAME_K: Final = 1e-3
"""Focal lengths and centres, in pixels, that differ by less are equal."""
SAME_INSTANT_NS: Final = 20_000_000
"""Largest difference of stamps of images that show the same view from a moving robot."""


def check_cameras(evidence: Evidence) -> Iterator[Finding]:
    """Check the calibration and the depth of every camera."""
    if evidence.master.graph is None:
        return
    keys = [each.key for each in evidence.streams if isinstance(each.key, StreamKey)]
    for camera in dict.fromkeys(key.camera.camera for key in keys):
        streams = {key.stream for key in keys if key.camera.camera == camera}
        if streams not in ({Stream.COLOR}, {Stream.POINTS}):
            yield from check_calibration(camera, Stream.COLOR, Stream.INFO, evidence)
        if evidence.of(camera, Stream.DEPTH_INFO):
            yield from check_calibration(camera, Stream.DEPTH, Stream.DEPTH_INFO, evidence)
        if {Stream.COLOR, Stream.DEPTH} <= streams:
            yield from _check_alignment(camera, evidence)
            yield from _check_instants(camera, evidence)


def _check_alignment(camera: str, evidence: Evidence) -> Iterator[Finding]:
    color, depth = image_of(camera, Stream.COLOR, evidence), image_of(camera, Stream.DEPTH, evidence)
    if color is None or depth is None:
        return
    info, depth_info = (calibration_of(camera, each, evidence) for each in (Stream.INFO, Stream.DEPTH_INFO))
    known = info is not None and depth_info is not None
    differ = _infos_differ(info, depth_info) if info and depth_info else ""
    apart = _apart(color, depth)
    if differ or (apart and not known):
        frames = (color.header.frame_id, depth.header.frame_id)
        yield from _unregistered(camera, differ or apart, frames, evidence)
        return
    seen = _placed(camera, evidence) if not apart else None
    elsewhere = f"the edges in both fit {_where(seen)}" if seen and not seen.aligned else ""
    if apart or elsewhere:
        yield _not_aligned(camera, apart or elsewhere, known=known)
    else:
        yield _aligned(camera, evidence, known=known, seen=seen is not None)


def _not_aligned(camera: str, how: str, *, known: bool) -> Finding:
    return problem(
        Stage.CAMERAS,
        f"{camera}/depth",
        f"not aligned with colour{' though their camera infos say so' if known else ''}: {how}",
        "have the driver register depth to colour (align_depth, depth_registration), or publish depth's own camera "
        "info: distances are wrong until then",
    )


def _aligned(camera: str, evidence: Evidence, *, known: bool, seen: bool) -> Finding:
    if known:
        shown = ", and its edges lie on colour's" if seen else "; whether its edges lie on colour's is not clear here"
        what = f"registered to colour by camera infos, sizes and frames{shown}"
        return fine(Stage.CAMERAS, f"{camera}/depth", what)
    return note(
        Stage.CAMERAS,
        f"{camera}/depth",
        "sizes and frames are those of colour"
        + (", and so are its edges" if seen else "; without both camera infos it is unknown whether they are aligned"),
        advice.calibration_of(camera, Stream.DEPTH, Stream.DEPTH_INFO, evidence),
    )


def _placed(camera: str, evidence: Evidence) -> Placement | None:
    """Return the placement of depth on colour, from two images of one instant."""
    looks = [evidence.of(camera, stream) for stream in (Stream.COLOR, Stream.DEPTH)]
    colors, depths = (_images(look) for look in looks)
    pairs = [(color, depth) for color in colors for depth in depths]
    apart_ns = [abs(color.header.stamp_ns - depth.header.stamp_ns) for color, depth in pairs]
    if not pairs or min(apart_ns) > SAME_INSTANT_NS:
        return None
    return placement(*pairs[apart_ns.index(min(apart_ns))])


def _images(look: StreamLook | None) -> list[ImageFrame]:
    return [each for each in look.heard.messages if isinstance(each, ImageFrame)] if look else []


def _where(seen: Placement) -> str:
    return f"when depth is scaled by {seen.scale:.2f} and moved {seen.right} pixels right, {seen.down} down"


def _apart(color: ImageFrame, depth: ImageFrame) -> str:
    """Return how the images differ, or an empty string."""
    if pixels(color) != pixels(depth):
        return f"colour has {by(pixels(color))} pixels, depth {by(pixels(depth))}"
    if color.header.frame_id != depth.header.frame_id:
        return f"colour is in frame {color.header.frame_id!r}, depth in {depth.header.frame_id!r}"
    return ""


def _infos_differ(info: CameraInfo, depth_info: CameraInfo) -> str:
    """Return how the calibrations differ, or an empty string."""
    if sent_pixels(info) != sent_pixels(depth_info):
        return f"camera infos of {by(sent_pixels(info))} and {by(sent_pixels(depth_info))} pixels"
    if any(abs(ours - theirs) > SAME_K for ours, theirs in zip(info.k, depth_info.k, strict=True)):
        return f"camera infos with other lenses (focal lengths {info.k[0]:.1f} and {depth_info.k[0]:.1f} pixels)"
    if info.header.frame_id != depth_info.header.frame_id:
        return f"camera infos in frames {info.header.frame_id!r} and {depth_info.header.frame_id!r}"
    return ""


def _unregistered(camera: str, what: str, frames: tuple[str, str], evidence: Evidence) -> Iterator[Finding]:
    """Report depth with a view of its own: workers have to transform it into colour's."""
    subject = f"{camera}/depth"
    if frames[0] == frames[1] or connected(links(evidence), *frames):
        yield note(
            Stage.CAMERAS,
            subject,
            f"not registered to colour ({what}): workers must do it, from the calibrations and transforms",
            "registering in the driver (align_depth, depth_registration) is exact and costs the robot less",
        )
    elif (moving := evidence.named(TF)) and moving.publishers:  # of which only the first messages are known
        yield note(
            Stage.CAMERAS,
            subject,
            f"not registered to colour ({what}), and neither tf_static nor the first messages of tf connect "
            f"{frames[0]!r} and {frames[1]!r}: unless later ones do, depth cannot be laid over colour",
            f"if `rosrun tf tf_echo {frames[0]} {frames[1]}` finds no transform either, publish a static one",
        )
    else:
        yield problem(
            Stage.CAMERAS,
            subject,
            f"not registered to colour ({what}), and tf_static does not connect {frames[0]!r} and {frames[1]!r}: "
            "depth cannot be laid over colour",
            "have the driver register depth to colour, or publish the static transform between the two frames",
        )


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
