import pytest

from gateway.requests import request_for, response_of
from gateway.ros1.errors import MessageError
from gateway.ros1.tcpros.service_client import EMPTY, SET_BOOL, TRIGGER, ServiceAnswer
from gateway.ros1.wire.tcpros import TopicType
from schemas.ros import MAX_ANSWER_TEXT, ServiceRequest, ServiceResponse

OTHER = TopicType("nav_msgs/GetMap", "6cdd0a18e0aff5b0a3ca2326a89b54ff")


def test_requests_of_std_srvs_are_made_here() -> None:
    assert request_for(TRIGGER, ServiceRequest(timeout_s=1)) == b""
    assert request_for(SET_BOOL, ServiceRequest(argument=True, timeout_s=1)) == b"\1"
    with pytest.raises(MessageError, match="needs to be told"):
        request_for(SET_BOOL, ServiceRequest(timeout_s=1))


@pytest.mark.parametrize("kind", [OTHER, TRIGGER, TopicType("std_srvs/SetBool", "0" * 32)])
def test_data_is_sent_as_it_is(kind: TopicType) -> None:
    assert request_for(kind, ServiceRequest(data=b"\7", timeout_s=1)) == b"\7"


@pytest.mark.parametrize("kind", [OTHER, TopicType("std_srvs/SetBool", "0" * 32)])
def test_another_type_needs_data(kind: TopicType) -> None:
    with pytest.raises(MessageError, match=rf"a {kind.name} \[{kind.md5sum}\] needs its request serialised, as data"):
        request_for(kind, ServiceRequest(argument=True, timeout_s=1))


def test_responses_of_std_srvs_are_read_and_others_are_not() -> None:
    data = b"\0\2\0\0\0no"
    assert response_of(ServiceAnswer(TRIGGER, data)) == ServiceResponse(
        type=TRIGGER.name, md5=TRIGGER.md5sum, success=False, message="no", data=memoryview(data)
    )
    assert response_of(ServiceAnswer(EMPTY, b"")).success is None
    other = response_of(ServiceAnswer(OTHER, data))
    assert (other.type, other.md5, other.success, other.message, bytes(other.data)) == (
        OTHER.name,
        OTHER.md5sum,
        None,
        None,
        data,
    )
    with pytest.raises(MessageError):
        response_of(ServiceAnswer(TRIGGER, b"\0"))


def test_a_long_message_is_cut() -> None:
    said = response_of(ServiceAnswer(TRIGGER, b"\1\0\0\2\0" + b"x" * (2 << 16)))
    assert said.message is not None
    assert len(said.message) == MAX_ANSWER_TEXT
