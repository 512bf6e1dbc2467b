"""Translators from ROS 1 messages to the fleet's schemas, one per message type. Pure."""

from gateway.to_bus.translators.kinds import kind_of
from gateway.to_bus.translators.stream_kind import Incomplete, Merging, NotOrganised, Repaired, StreamKind, Translate

__all__ = ["Incomplete", "Merging", "NotOrganised", "Repaired", "StreamKind", "Translate", "kind_of"]
