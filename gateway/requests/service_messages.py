"""What is asked of a service and what it answers, between ROS and the fleet. Pure."""

from gateway.ros1.errors import MessageError
from gateway.ros1.service_client import ServiceAnswer
from gateway.ros1.std_srvs import ALL, deserialise_response, serialise_request
from gateway.ros1.wire.tcpros import TopicType
from schemas.service import MAX_ANSWER_TEXT, ServiceRequest, ServiceResponse


def request_for(kind: TopicType, asked: ServiceRequest) -> bytes:
    """Return the serialised request for a service that turned out to be of a type.

    Raises:
        MessageError: what is asked does not fit the type.
    """
    if asked.data is not None:
        return asked.data
    if kind in ALL:
        return serialise_request(kind, argument=asked.argument)
    raise MessageError(f"a {kind.name} [{kind.md5sum}] needs its request serialised, as data")


def response_of(answer: ServiceAnswer) -> ServiceResponse:
    """Return a service's answer as a message.

    Raises:
        MessageError: it is not what its type says.
    """
    said = deserialise_response(answer.type, answer.data) if answer.type in ALL else None
    return ServiceResponse(
        type=answer.type.name,
        md5=answer.type.md5sum,
        success=said.success if said else None,
        message=said.message[:MAX_ANSWER_TEXT] if said else None,
        data=memoryview(answer.data),
    )
