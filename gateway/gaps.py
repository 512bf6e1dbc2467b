"""Gaps in the numbers that ROS publishers give what they send. Pure."""

import struct
from typing import Final

from gateway.ros1 import image, point_cloud
from gateway.ros1.subscriber import Message
from gateway.translators import camera_info, compressed_image, disparity
from schemas.header import gap

NUMBERED: Final = frozenset(
    (image.TYPE_NAME, compressed_image.TYPE_NAME, camera_info.TYPE_NAME, point_cloud.TYPE_NAME, disparity.TYPE_NAME)
)
"""Types that begin with a std_msgs/Header, whose first field is a number that ROS's own publishers count."""

MAX_PUBLISHERS: Final = 64
_SEQ: Final = struct.Struct("<I")


class Gaps:
    """Counts the messages of a topic that its publishers numbered and that did not arrive.

    Nodes that pass on another's messages pass on their numbers too: what `throttle` leaves out counts as missing.
    """

    def __init__(self) -> None:
        self.missing = 0
        self._last: dict[str, int] = {}

    def begin(self) -> None:
        """Start anew after a pause: what was sent in the pause was never meant for us."""
        self._last.clear()

    def arrived(self, message: Message) -> None:
        """Note a message. A number no higher than the last, or far higher, begins another round, as when a bag loops.

        Latching publishers say nothing: rospy's give a number to each subscriber that comes late.
        """
        publisher = message.publisher
        if publisher.type.name not in NUMBERED or publisher.latching or len(message.data) < _SEQ.size:
            return
        (seq,) = _SEQ.unpack_from(message.data)
        last = self._last.get(message.uri)
        if last is None and len(self._last) >= MAX_PUBLISHERS:
            self._last.clear()
        self._last[message.uri] = seq
        if last is not None:
            self.missing += gap(last, seq)
