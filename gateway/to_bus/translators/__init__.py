"""Translators from ROS 1 messages to the fleet's schemas, one per message type. Pure.

A new message type takes its definition (`gateway.ros1.msg.known_messages`), a translator here, a line in `ros_types`, a
schema in `schemas` if it is a new kind of data, and a line in `gateway.discovery.candidates` if it is to be found by
itself. One that is forwarded as it is, as `ros/{name}`, takes nothing.
"""

from gateway.to_bus.translators.ros_types import kind_of
from gateway.to_bus.translators.stream_kind import Incomplete, Merging, NotOrganised, Repaired, StreamKind, Translate

__all__ = ["Incomplete", "Merging", "NotOrganised", "Repaired", "StreamKind", "Translate", "kind_of"]
