"""Header: the frame that a message is about, and its times."""

from typing import Annotated, Final

import msgspec

Name = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.\-]{0,63}$(?!\n)")]
"""A robot's, camera's or worker's name: one chunk of a key expression, safe in file names and URLs."""

MaybeName = Annotated[str, msgspec.Meta(pattern=r"^([A-Za-z0-9][A-Za-z0-9_.\-]{0,63})?$(?!\n)")]
"""A name, or empty."""

MAX_COUNT: Final = 2**63 - 1
Count = Annotated[int, msgspec.Meta(ge=0, le=MAX_COUNT)]
Nanoseconds = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
MAX_LABEL: Final = 256
Label = Annotated[str, msgspec.Meta(max_length=MAX_LABEL)]


LONGEST_GAP: Final = 1_000_000
"""Maximum number of missing frames, nine hours at 30 Hz; a larger gap means that counting restarted."""


class Header(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Identity and times of one frame. (robot, camera, boot_id, seq) names it uniquely: stamps repeat when bags loop.

    camera: empty in messages that belong to the whole robot.
    stamp_ns: the sensor's own stamp, nanoseconds of the robot's ROS clock; 0 where its message has none.
    received_ns: when the gateway had the whole frame, nanoseconds since the epoch on the robot's system clock.
    boot_id: one gateway process; a restarted gateway has another.
    seq: counts the frames of this stream that the gateway process could read and meant to send, from 0, without holes:
        what `max_hz` leaves out has no number, so a gap up to LONGEST_GAP is always a loss.
    """

    robot: Name
    camera: MaybeName = ""
    boot_id: Annotated[str, msgspec.Meta(max_length=64)]
    seq: Count
    stamp_ns: Nanoseconds
    frame_id: Label
    received_ns: Nanoseconds


def is_newer(header: Header, last: Header | None) -> bool:
    """Return whether a frame is newer than the last one taken of its stream, or comes from a new gateway process."""
    return last is None or header.boot_id != last.boot_id or header.seq > last.seq


def gap(last: int, number: int) -> int:
    """Return the number of missing frames between two; 0 if counting has restarted."""
    missing = number - last - 1
    return missing if 0 < missing <= LONGEST_GAP else 0


Spans = dict[Annotated[str, msgspec.Meta(max_length=32)], Count]
"""Time spent per stage, in nanoseconds, each on the clock of the machine that spent it."""
