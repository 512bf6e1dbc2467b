import msgspec
import pytest

from gateway.to_ros.stream import MAX_REMEMBERED, NewerFrames, UnseenMessages
from schemas.alerts import Alert
from schemas.errors import SchemaError
from schemas.keys import CameraKey, RobotStreamKey
from tests.gateway.to_ros.lists import class_list
from tests.schemas.results import alert


def returned(novelty: NewerFrames, boot_id: str, seq: int) -> bool:
    result = class_list(boot_id=boot_id, seq=seq)
    if new := novelty.is_new(result):
        novelty.remember(result)
    return new


def test_frames_only_go_forward_within_a_gateways_life() -> None:
    novelty = NewerFrames(CameraKey("r1", "front"))
    frames = [("a", 5), ("a", 5), ("a", 6), ("a", 5), ("b", 0), ("b", 0), ("b", 1)]
    assert [returned(novelty, *frame) for frame in frames] == [True, False, True, False, True, False, True]


def test_what_was_not_returned_is_still_new() -> None:
    novelty = NewerFrames(CameraKey("r1", "front"))
    assert novelty.is_new(class_list())
    assert novelty.is_new(class_list())


@pytest.mark.parametrize("key", [CameraKey("r2", "front"), CameraKey("r1", "rear")])
def test_a_frame_of_another_camera_is_refused(key: CameraKey) -> None:
    with pytest.raises(SchemaError, match="header says r1/front"):
        NewerFrames(key).is_new(class_list())


def unseen() -> UnseenMessages[Alert]:
    return UnseenMessages(RobotStreamKey("r1", "alerts"), lambda said: (said.id, said.changed_ns))


def test_a_message_is_new_once_and_again_when_it_has_changed() -> None:
    novelty = unseen()
    novelty.remember(alert(id_="a", changed_ns=1))
    assert not novelty.is_new(alert(id_="a", changed_ns=1))
    assert novelty.is_new(alert(id_="a", changed_ns=2))
    assert novelty.is_new(alert(id_="b", changed_ns=1))


def test_as_many_messages_are_remembered_as_there_is_room_for() -> None:
    novelty = unseen()
    messages = [msgspec.structs.replace(alert(), id=str(n)) for n in range(MAX_REMEMBERED + 1)]
    for message in messages[:-1]:
        novelty.remember(message)
    assert not any(novelty.is_new(message) for message in messages[:-1])
    novelty.remember(messages[-1])
    assert novelty.is_new(messages[0])
    assert not any(novelty.is_new(message) for message in messages[1:])


def test_a_message_for_another_robot_is_refused() -> None:
    with pytest.raises(SchemaError, match="it is for r2"):
        unseen().is_new(alert(robot="r2"))
