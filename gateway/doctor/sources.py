"""Checks whether several publishers of one topic send data of the same sensor. Pure."""

from collections.abc import Iterator
from typing import Final

from gateway.doctor.calibration import by, pixels
from gateway.doctor.evidence import StreamLook
from gateway.doctor.finding import Finding, Stage, note, problem
from gateway.doctor.frames import bare
from schemas.camera_info import CameraInfo
from schemas.codec import Message
from schemas.image import ImageFrame
from schemas.keys import StreamKey
from schemas.points import PointCloud

_REMAP: Final = "stop the extra node, or remap its topic: each sensor needs a topic of its own"


def check_sources(stream: StreamLook) -> Iterator[Finding]:
    """Report a camera's topic with several sensors on it; others, such as tf, may have many publishers."""
    if not isinstance(stream.key, StreamKey):
        return
    heard = {each.node: each.heard.messages for each in stream.publishers if each.heard.messages}
    frames, shapes = (
        {node: sorted({of(message) for message in messages}) for node, messages in heard.items()}
        for of in (_frame, _shape)
    )
    for told in (frames, shapes):
        if len({each for several in told.values() for each in several}) > 1:
            said = "; ".join(f"{node} sends {' and '.join(several)}" for node, several in told.items())
            yield problem(Stage.SENSORS, stream.subject, f"it mixes several sensors: {said}", _REMAP)
            return
    if len(heard) > 1:
        what = f"{' and '.join(heard)} all publish it: each frame may come several times"
        yield note(Stage.SENSORS, stream.subject, what, _REMAP)


def _frame(message: Message) -> str:
    header = message.header if isinstance(message, ImageFrame | CameraInfo | PointCloud) else None
    return f"frame {bare(header.frame_id)!r}" if header else ""


def _shape(message: Message) -> str:
    """Return the properties that all messages of one sensor share."""
    if isinstance(message, ImageFrame):
        return f"{by(pixels(message))} pixels"
    if isinstance(message, CameraInfo):
        return f"the calibration of a lens of {message.k[0]:.1f} pixels' focal length"
    return ""
