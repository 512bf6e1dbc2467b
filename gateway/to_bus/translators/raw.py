"""std_msgs/String to Text, and a message of any type to RawMessage."""

import struct
from typing import Final

from gateway.ros1.errors import MessageError
from gateway.ros1.messages import definition_of
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.translators.stream_kind import label
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.ros import MAX_DEFINITION, MAX_MD5, MAX_TEXT, RawMessage, Text

STRING: Final = "std_msgs/String"
_LENGTH: Final = struct.Struct("<I")


def text(message: Message, header: Header) -> Text:
    """Translate a text."""
    sent = memoryview(message.data)
    if len(sent) < _LENGTH.size or _LENGTH.unpack_from(sent)[0] != len(sent) - _LENGTH.size:
        raise MessageError(f"{len(sent)} bytes are not a {STRING}")
    found = str(sent[_LENGTH.size :], "utf-8", "replace")  # as ROS's own tools show other encodings
    if len(found) > MAX_TEXT:
        raise SchemaError(f"a text of {len(found)} characters, at most {MAX_TEXT} are carried")
    return Text(header=header, text=found)


def raw(message: Message, header: Header) -> RawMessage:
    """Put a message of any type into an envelope."""
    publisher = message.publisher
    definition = definition_of(publisher)
    if len(definition) > MAX_DEFINITION:
        raise SchemaError(f"{publisher.type.name[:80]} with a definition of {len(definition)} characters")
    if len(publisher.type.md5sum) > MAX_MD5:
        raise SchemaError(f"{publisher.type.name[:80]} with an md5sum of {len(publisher.type.md5sum)} characters")
    return RawMessage(
        header=header,
        type=label("type", publisher.type.name),
        md5=publisher.type.md5sum,
        definition=definition,
        latched=publisher.latching,
        data=memoryview(message.data),
    )
