"""Checks whether several publishers of one topic send data of the same sensor. Pure."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
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

_SAME_LENS: Final = 0.02
"""Two nodes may hear of one lens at different times, while it focuses: their focal lengths may be so far apart."""

_Lens = tuple[float, float]
"""The least and the greatest focal length that a node sent, in pixels."""


def check_sources(stream: StreamLook) -> Iterator[Finding]:
    """Report a camera's topic with several sensors on it; others, such as tf, may have many publishers."""
    if not isinstance(stream.key, StreamKey):
        return
    heard = {each.node: each.heard.messages for each in stream.publishers if each.heard.messages}
    frames, shapes = (
        {node: sorted({of(message) for message in messages}) for node, messages in heard.items()}
        for of in (_frame, _shape)
    )
    lenses = {node: lens for node, messages in heard.items() if (lens := _lens(messages)) is not None}
    for differ, told in (
        (_are_several(frames), frames),
        (_are_several(shapes), shapes),
        (_are_two_lenses(lenses.values()), {node: [_focal_length(lens)] for node, lens in lenses.items()}),
    ):
        if differ:
            said = "; ".join(f"{node} sends {' and '.join(several)}" for node, several in told.items())
            yield problem(Stage.SENSORS, stream.subject, f"it mixes several sensors: {said}", _REMAP)
            return
    if len(heard) > 1:
        what = f"{' and '.join(heard)} all publish it: each frame may come several times"
        yield note(Stage.SENSORS, stream.subject, what, _REMAP)


def _are_several(told: Mapping[str, Sequence[str]]) -> bool:
    return len({each for several in told.values() for each in several}) > 1


def _are_two_lenses(lenses: Collection[_Lens]) -> bool:
    """Return whether two nodes' focal lengths are apart; those of one change with focus and zoom."""
    if not lenses:
        return False
    least, most = min(most for _, most in lenses), max(least for least, _ in lenses)
    return most > least * (1 + _SAME_LENS)


def _lens(messages: Iterable[Message]) -> _Lens | None:
    found = [message.k[0] for message in messages if isinstance(message, CameraInfo)]
    return (min(found), max(found)) if found else None


def _focal_length(lens: _Lens) -> str:
    least, most = (f"{each:.1f}" for each in lens)
    return f"the calibration of a lens of {least if least == most else f'{least} to {most}'} pixels' focal length"


def _frame(message: Message) -> str:
    header = message.header if isinstance(message, ImageFrame | CameraInfo | PointCloud) else None
    return f"frame {bare(header.frame_id)!r}" if header else ""


def _shape(message: Message) -> str:
    """Return the size of an image, which is the same in all that one sensor sends."""
    return f"{by(pixels(message))} pixels" if isinstance(message, ImageFrame) else ""
