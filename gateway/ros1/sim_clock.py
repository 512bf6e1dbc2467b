"""ROS time under `/use_sim_time`: the last message of `/clock`. Pure."""

from __future__ import annotations

import struct

from gateway.ros1.errors import MessageError

PARAMETER = "/use_sim_time"
TOPIC = "/clock"
TYPE_NAME = "rosgraph_msgs/Clock"
_CLOCK = struct.Struct("<II")


class SimClock:
    """A clock set by messages; it may go backward.

    used: whether ROS time is this clock's and not the system's. now_ns: 0 until it was told. jumps: how often it went
    back, as it does when a bag that is played begins again: earlier times are then of another round.
    """

    def __init__(self) -> None:
        self.used = False
        self.now_ns = 0
        self.jumps = 0

    @property
    def ros_time_ns(self) -> int | None:
        """ROS time in nanoseconds, or None if that is the system's."""
        return self.now_ns if self.used else None

    def tell(self, now_ns: int) -> bool:
        """Set the clock; return whether it jumped back."""
        jumped = now_ns < self.now_ns
        self.jumps += jumped
        self.now_ns = now_ns
        return jumped


def decode_clock(data: bytes | bytearray | memoryview) -> int:
    """Return the time of a rosgraph_msgs/Clock in nanoseconds.

    Raises:
        MessageError: the bytes are not such a message.

    """
    if len(data) != _CLOCK.size:
        raise MessageError(f"{len(data)} bytes are not a {TYPE_NAME}")
    seconds, nanoseconds = _CLOCK.unpack(data)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)
