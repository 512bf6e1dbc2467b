"""A returned stream without a bus or ROS around it."""

from typing import Any

from gateway.ros1.errors import MessageError
from gateway.ros1.messages import deserialise
from gateway.to_ros.stream import R, StreamReturn
from schemas import codec
from schemas.errors import SchemaError
from schemas.status import ReturnStatus


def take(stream: StreamReturn[R], payload: bytes, replaced: int = 0) -> Any:
    """Take a payload as `Return` does; return the ROS message as an object, or None."""
    result = stream.receive(payload, codec.encoding(stream.translator.schema), replaced)
    if result is None:
        return None
    try:
        message = stream.translator.translate(result, stream.next_number)
    except (MessageError, SchemaError) as error:
        stream.leave_out(error)
        return None
    stream.returned(result)
    return deserialise(stream.translator.ros_type, message)


def status(stream: StreamReturn[R]) -> ReturnStatus:
    """Account for a stream with one subscriber, which is quick."""
    return stream.status(wanted=True, subscribers=1, slow=0)
