"""ROS 1 topics and services that travel untranslated: RawMessage, Text, and calls of a robot's services."""

from typing import Annotated, Final

import msgspec

from schemas.errors import SchemaError
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


MAX_SERVICE_BYTES: Final = 8 * 1024 * 1024
MAX_CALL_S: Final = 55.0
"""Longest time that a service may take: a bit less than any request on the bus."""

MAX_ANSWER_TEXT: Final = 64 * 1024


class ServiceRequest(msgspec.Struct, frozen=True, kw_only=True):
    """A request to a ROS service. The key names the service.

    type: such as std_srvs/Trigger; md5: the type's md5sum; empty for whatever the service is.
    argument: what a std_srvs/SetBool is told; std_srvs/Empty and Trigger take none.
    data: the serialised request of a service of any other type. timeout_s: how long the service may take.
    """

    type: Label = ""
    md5: Annotated[str, msgspec.Meta(max_length=MAX_MD5)] = ""
    argument: bool | None = None
    data: Annotated[bytes, msgspec.Meta(max_length=MAX_SERVICE_BYTES)] | None = None
    timeout_s: Annotated[float, msgspec.Meta(gt=0, le=MAX_CALL_S)]

    def __post_init__(self) -> None:
        """Check that a request gives at most one argument.

        Raises:
            SchemaError: both an argument and data.
        """
        if self.argument is not None and self.data is not None:
            raise SchemaError("a service is given an argument or data, not both")


class ServiceResponse(msgspec.Struct, frozen=True, kw_only=True):
    """The response of a ROS service.

    type, md5: the service's. success, message: what a std_srvs/Trigger or SetBool answered, None for any other type.
    data: the serialised response, whatever its type; decoded without a copy.
    """

    type: Label
    md5: Annotated[str, msgspec.Meta(max_length=MAX_MD5)]
    success: bool | None = None
    message: Annotated[str, msgspec.Meta(max_length=MAX_ANSWER_TEXT)] | None = None
    data: memoryview
