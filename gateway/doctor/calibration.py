"""Checks camera infos: whether pixels can be projected into space. Pure."""

from collections.abc import Iterator
from typing import Final

from gateway.discovery import published_topics
from gateway.doctor import advice
from gateway.doctor.evidence import Evidence
from gateway.doctor.finding import Finding, Stage, note, problem
from schemas.camera_info import PLUMB_BOB, RATIONAL, CameraInfo, coefficients_of, is_calibrated
from schemas.image import ImageFrame
from schemas.keys import Stream

OFF_CENTRE: Final = 1 / 3
"""Largest offset of the principal point from the centre, as a fraction of width or height; lenses reach 0.1."""


def info_of(camera: str, stream: Stream, evidence: Evidence) -> CameraInfo | None:
    """Return the camera info received on a camera's stream."""
    look = evidence.of(camera, stream)
    return look.heard.message if look and isinstance(look.heard.message, CameraInfo) else None


def calibration_of(camera: str, stream: Stream, evidence: Evidence) -> CameraInfo | None:
    """Return the camera info if it is a calibration: uncalibrated drivers send one without a focal length."""
    info = info_of(camera, stream, evidence)
    return info if is_calibrated(info) else None


def image_of(camera: str, stream: Stream, evidence: Evidence) -> ImageFrame | None:
    """Return the first image received on a camera's stream."""
    look = evidence.of(camera, stream)
    return look.heard.message if look and isinstance(look.heard.message, ImageFrame) else None


def check_calibration(camera: str, of: Stream, stream: Stream, evidence: Evidence) -> Iterator[Finding]:
    """Check the calibration on `stream`, which belongs to the images on `of`."""
    info, image = info_of(camera, stream, evidence), image_of(camera, of, evidence)
    if info is None:
        yield _without_calibration(camera, of, stream, evidence)
        return
    subject = f"{camera}/{stream}"
    if not is_calibrated(info):
        yield problem(
            Stage.CAMERAS,
            subject,
            "the camera info has no focal length: the camera is not calibrated, so its pixels cannot "
            "be projected into space",
            f"calibrate it (`{_calibrator(camera, of, evidence)}`), or have the driver load its calibration",
        )
        return
    if isinstance(lens := coefficients_of(info.distortion_model, info.d), str):
        yield problem(
            Stage.CAMERAS,
            subject,
            f"{lens}: the camera's pixels cannot be projected into space",
            f"have the driver publish a calibration with {PLUMB_BOB}, {RATIONAL} or equidistant distortion",
        )
    if where := _off_centre(info, image):
        yield problem(
            Stage.CAMERAS,
            subject,
            f"the calibration does not match the images: its principal point {where}",
            "have the driver load this camera's calibration at the resolution that it sends: distances and places are "
            "wrong until then",
        )
    if not evidence.is_mapped(camera, stream):
        topic = getattr(evidence.of(camera, stream), "topic", "")
        yield note(
            Stage.CAMERAS,
            subject,
            f"{topic} has the calibration but is not a stream, so distances cannot be measured off the robot",
            advice.taking(subject, topic, evidence),
        )
    if image is not None and sent_pixels(info) != pixels(image):
        yield problem(
            Stage.CAMERAS,
            subject,
            f"the camera info is for {by(sent_pixels(info))} pixels, {of} has {by(pixels(image))}",
            "have the driver publish the calibration of the resolution it sends",
        )


def _off_centre(info: CameraInfo, image: ImageFrame | None) -> str:
    """Return in words where the principal point is, if outside the full image or a third off its centre."""
    size = (info.width, info.height) if info.width and info.height else pixels(image) if image else (0, 0)
    at = info.k[2], info.k[5]
    if not all(size) or all(abs(each - side / 2) <= side * OFF_CENTRE for each, side in zip(at, size, strict=True)):
        return ""
    inside = all(0 <= each <= side for each, side in zip(at, size, strict=True))
    return f"({at[0]:.0f}, {at[1]:.0f}) is {'far off the centre' if inside else 'outside'} of {by(size)} pixels"


def _calibrator(camera: str, of: Stream, evidence: Evidence) -> str:
    """Return the command to calibrate a camera with a chessboard of 9 x 7 squares of 2.5 cm."""
    look = evidence.of(camera, of)
    topic = published_topics.image_of(look.topic) if look else "TOPIC"
    board, space = "--size 8x6 --square 0.025", topic.rpartition("/")[0] or "/"
    return f"rosrun camera_calibration cameracalibrator.py {board} image:={topic} camera:={space}"


def _without_calibration(camera: str, of: Stream, stream: Stream, evidence: Evidence) -> Finding:
    subject, look = f"{camera}/{stream}", evidence.of(camera, stream)
    if look is not None and look.publishers:
        return problem(
            Stage.CAMERAS,
            subject,
            f"no camera info came from {look.topic}",
            "restart the driver or correct its camera info: one should come with every image",
        )
    return note(
        Stage.CAMERAS,
        subject,
        "no camera info: depth pixels cannot be projected into space",
        advice.calibration_of(camera, of, stream, evidence),
    )


def sent_pixels(info: CameraInfo) -> tuple[int, int]:
    """Return width and height of the camera's images in pixels, after region of interest and binning."""
    width, height = (
        (info.roi.width, info.roi.height) if info.roi.width and info.roi.height else (info.width, info.height)
    )
    return width // max(info.binning_x, 1), height // max(info.binning_y, 1)


def pixels(image: ImageFrame) -> tuple[int, int]:
    return image.width, image.height


def by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
