"""Header: the frame that a message is about, and its times; and the order of frames. Pure: time is an argument."""

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
        frames that `max_hz` leaves out have no number, so a gap up to LONGEST_GAP is always a loss.

    >>> header = fleetsight.Header(
    ...     robot="r1", camera="front", boot_id="b1", seq=7, stamp_ns=10**18, frame_id="camera_optical_frame",
    ...     received_ns=10**18 + 20_000_000,
    ... )
    >>> (header.received_ns - header.stamp_ns) / 1e6  # milliseconds, if both clocks of the robot are the same
    20.0
    """

    robot: Name
    camera: MaybeName = ""
    boot_id: Annotated[str, msgspec.Meta(max_length=64)]
    seq: Count
    stamp_ns: Nanoseconds
    frame_id: Label
    received_ns: Nanoseconds


def gap(last: int, number: int) -> int:
    """Return the number of missing frames between two; 0 if counting has restarted."""
    missing = number - last - 1
    return missing if 0 < missing <= LONGEST_GAP else 0


Spans = dict[Annotated[str, msgspec.Meta(max_length=32)], Count]
"""Time spent per stage, in nanoseconds, each on the clock of the machine that spent it."""


MAX_BOOTS: Final = 4
"""Maximum number of a gateway's processes remembered; messages of a replaced one are late."""

QUIET_NS: Final = 3_000_000_000
"""Silence of the newest process after which a replaced one is accepted again: it is the only one running.

Frames of the newest process that are late for as long, each newer than the one before, while none is newer than all,
are accepted too: their count is the one that goes on.
"""

LONGEST_PAUSE_NS: Final = 10_000_000_000
"""Time without a late frame after which the next one begins anew: publishers send kept frames again, in bursts."""


class FrameOrder:
    """Knows the newest frame of one stream, by the gateway's process and number: stamps repeat when bags loop.

    A number alone is not trusted for long. One message with a number far ahead, from a fault or from somebody who
    speaks for the robot, would make every later frame an old one, for ever. late, implausible: how many were refused.

    late: older than the newest one, or the same again. implausible: more than LONGEST_GAP ahead of it; when another one
    goes on from there, the count is believed, and steps as long as that.
    """

    __slots__ = (
        "_ahead",
        "_at_ns",
        "_boot_id",
        "_late_at_ns",
        "_late_seq",
        "_late_since_ns",
        "_most",
        "_outlived",
        "_seq",
        "implausible",
        "late",
    )

    def __init__(self) -> None:
        self._boot_id = ""
        self._seq = -1
        self._at_ns = 0
        self._outlived: tuple[tuple[str, int], ...] = ()
        self._ahead = -1
        self._most = LONGEST_GAP
        self._late_seq = -1
        self._late_since_ns = 0
        self._late_at_ns = 0
        self.late = 0
        self.implausible = 0

    def take(self, header: Header, at_ns: int) -> bool:
        """Return whether a frame that came at `at_ns` is newer than all before it, and remember it."""
        newer = self.admits(header, at_ns)
        if newer:
            self.note(header, at_ns)
        return newer

    def admits(self, header: Header, at_ns: int) -> bool:
        """Return whether a frame that came at `at_ns` is newer than all before it; count it if it is not."""
        if header.boot_id != self._boot_id:
            newer = self._is_of_a_living_process(header, at_ns)
        elif header.seq > self._seq:
            return self._is_plausible(header.seq)
        else:
            newer = self._goes_on(header.seq, at_ns)
        self.late += not newer
        return newer

    def note(self, header: Header, at_ns: int) -> None:
        """Remember a frame as the newest."""
        if header.boot_id != self._boot_id:
            others = [each for each in self._outlived if each[0] != header.boot_id]
            self._outlived = ((self._boot_id, self._seq), *others)[: MAX_BOOTS - 1]
            self._boot_id = header.boot_id
        self._seq, self._at_ns = header.seq, at_ns
        self._ahead = self._late_seq = -1

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now: the clock was set back."""
        self._at_ns = min(self._at_ns, now_ns)
        self._late_since_ns = min(self._late_since_ns, now_ns)
        self._late_at_ns = min(self._late_at_ns, now_ns)

    def _is_of_a_living_process(self, header: Header, at_ns: int) -> bool:
        last_seq = dict(self._outlived).get(header.boot_id)
        return last_seq is None or (header.seq > last_seq and at_ns - self._at_ns > QUIET_NS)

    def _is_plausible(self, seq: int) -> bool:
        if seq - self._seq <= self._most:
            return True
        if 0 <= self._ahead < seq:
            self._most = max(self._most, 2 * (seq - self._ahead))  # this sender's steps are as long as that
            return True
        self._ahead = seq
        self.implausible += 1
        return False

    def _goes_on(self, seq: int, at_ns: int) -> bool:
        """Return whether late frames are those that go on: for QUIET_NS each newer than the last, and no others."""
        if self._late_seq < 0 or seq <= self._late_seq or at_ns - self._late_at_ns > LONGEST_PAUSE_NS:
            self._late_since_ns = at_ns
        self._late_seq, self._late_at_ns = seq, at_ns
        return at_ns - max(self._late_since_ns, self._at_ns) > QUIET_NS
