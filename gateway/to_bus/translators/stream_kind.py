"""Kinds of streams: a schema, and its translators from ROS messages."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol, runtime_checkable

import msgspec

from bus import QoS
from gateway.ros1.tcpros.subscriber import Message
from gateway.ros1.wire.tcpros import ANY
from schemas import codec
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL, Header

MIB: Final = 1 << 20

Translate = Callable[[Message, Header], codec.Message]
"""Given a ROS message and a header without stamp and frame_id, returns the fleet's own message.

Raises MessageError or SchemaError for bytes that are not such a message, Incomplete for those of which a part is, and
Repaired for those that contradict themselves and can mean one thing only.
"""


class Incomplete(SchemaError):  # noqa: N818 - it is one only to those who want all of a message
    """Parts of a message cannot be carried. rest: the message without them. left_out: their number."""

    def __init__(self, rest: codec.Message, left_out: int, what: str) -> None:
        super().__init__(f"sent without {left_out} {what}")
        self.rest = rest
        self.left_out = left_out


class Repaired(SchemaError):  # noqa: N818 - it is one only to those who want messages without faults
    """A message was repaired. made: its translation."""

    def __init__(self, made: codec.Message, what: str) -> None:
        super().__init__(f"sent repaired: {what}")
        self.made = made


class NotOrganised(SchemaError):  # noqa: N818 - a cloud without the rows and colours of a picture is sound
    """A cloud is not an image, nor will later ones be with the driver's present settings."""


@runtime_checkable
class Merging(Protocol):
    """A translation with state for each subscription."""

    def begin(self) -> None:
        """Start a subscription."""


@dataclass(frozen=True, slots=True)
class StreamKind:
    """A schema, and by ROS type (`*` for any) the factories of translators of a topic's messages.

    Types with the same beginning share one translation of a topic's messages.
    max_bytes: a longer ROS message is not looked at. merges: each message holds what all publishers said before.
    """

    schema: type[codec.Message]
    qos: QoS
    translators: Mapping[str, Callable[[], Translate]]
    max_bytes: int = 1024 * MIB
    merges: bool = False

    @property
    def is_droppable(self) -> bool:
        """Whether messages may be dropped beyond the rates of the settings or the link."""
        return self.qos in (QoS.IMAGE, QoS.MESSAGE)

    @property
    def encoding(self) -> str:
        """The Zenoh encoding of the payloads."""
        return codec.encoding(self.schema)

    @property
    def ros_type(self) -> str:
        """The ROS type to subscribe to: the only one, or `*`."""
        return next(iter(self.translators)) if len(self.translators) == 1 else ANY


def each(translate: Translate) -> Callable[[], Translate]:
    """Return a factory for a translator that treats each message alone."""
    return lambda: translate


def stamped(header: Header, stamp_ns: int, frame_id: str) -> Header:
    """Return the header with a ROS message's stamp and frame; a long frame is cut to the contract's limit."""
    return msgspec.structs.replace(header, stamp_ns=stamp_ns, frame_id=frame_id[:MAX_LABEL])


def stamp_of(header: Any) -> int:
    """Return the stamp of a deserialised std_msgs/Header in nanoseconds."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def label(what: str, text: str) -> str:
    """Return a name if it fits the contract's length. what: the named thing, for the error.

    Raises:
        SchemaError: it is too long for that.
    """
    if len(text) > MAX_LABEL:
        raise SchemaError(f"{what} with a name of {len(text)} characters")
    return text
