"""What the gateway forwards of topics that are no sensor streams of their own: texts, and messages of any type."""

from typing import Annotated, Final

import msgspec

from schemas.header import Header, Label

MAX_TEXT: Final = 256 * 1024
MAX_DEFINITION: Final = 1024 * 1024
MAX_MD5: Final = 32


class Text(msgspec.Struct, frozen=True, kw_only=True):
    """A std_msgs/String."""

    header: Header
    text: Annotated[str, msgspec.Meta(max_length=MAX_TEXT)]


class RawMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A ROS message of any type, not translated; the header's stamp_ns is 0.

    type: such as nav_msgs/OccupancyGrid. md5: the type's md5sum. definition: its whole definition, that of its
    dependencies included, as its publisher gave it, or as the gateway knows it where that gave none; else empty.
    latched: its publisher keeps it for late ROS subscribers.
    data: the serialised message; decoded without a copy, so it is a view into the received payload.
    """

    header: Header
    type: Label
    md5: Annotated[str, msgspec.Meta(max_length=MAX_MD5)]
    definition: Annotated[str, msgspec.Meta(max_length=MAX_DEFINITION)]
    latched: bool
    data: memoryview
