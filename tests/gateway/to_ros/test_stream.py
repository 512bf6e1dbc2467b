import logging
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from gateway.to_ros.outputs import actions_return, alerts_return, camera_returns
from gateway.to_ros.stream import DOUBLED, MALFORMED, REFUSED, REPLACED, SLOW, UNHEARD, StreamReturn
from schemas import codec
from schemas.detections import ClassList
from schemas.keys import CameraKey
from schemas.status import ReturnStatus
from tests.gateway.to_ros.lists import class_list
from tests.gateway.to_ros.namespaces import IN_ROOT
from tests.gateway.to_ros.overlays import overlay
from tests.gateway.to_ros.taking import status, take
from tests.schemas.results import action, alert, cloud, clouds, distances, known

ENCODING = codec.encoding(ClassList)
KEY = "fleet/r1/front/classes"
RESULTS: dict[str, Callable[..., codec.Message]] = {
    "classes": lambda **of: class_list(("box", 2), **of),
    "distances": lambda **of: distances(known("box", 2.5), **of),
    "overlay/detection": overlay,
    "overlay/segmentation": overlay,
    "objects": lambda **of: clouds(cloud((0.0, 0.5, 2.0)), **of),
}


def streams() -> dict[str, StreamReturn[Any]]:
    made = camera_returns(CameraKey("r1", "front"), "/ultralytics", IN_ROOT)
    return {stream.key.stream: stream for stream in made}


@pytest.fixture
def stream() -> StreamReturn[ClassList]:
    return streams()["classes"]


def text(stream: StreamReturn[Any], message: codec.Message, replaced: int = 0) -> str | None:
    found = take(stream, codec.encode(message), replaced)
    return None if found is None else str(found.data)


def test_every_result_has_its_key_and_the_guides_topic() -> None:
    assert {str(stream.key): stream.topics[""] for stream in streams().values()} == {
        "fleet/r1/front/classes": "/ultralytics/detection/classes",
        "fleet/r1/front/distances": "/ultralytics/detection/distance",
        "fleet/r1/front/overlay/detection": "/ultralytics/detection/image",
        "fleet/r1/front/overlay/segmentation": "/ultralytics/segmentation/image",
        "fleet/r1/front/objects": "/ultralytics/segmentation/points",
    }
    alerts = alerts_return("r1", IN_ROOT)
    assert (str(alerts.key), alerts.topics[""]) == ("fleet/r1/alerts", "/ultralytics/alerts")


@pytest.mark.parametrize("name", RESULTS)
def test_every_result_is_returned_once_and_held_to_its_camera(name: str) -> None:
    stream, make = streams()[name], RESULTS[name]
    taken = [take(stream, codec.encode(make(seq=seq, camera=camera))) for seq, camera in ((4, "rear"), (4, "front"))]
    assert [message is not None for message in taken] == [False, True]
    assert take(stream, codec.encode(make(seq=4))) is None
    assert take(stream, codec.encode(make(seq=5))) is not None
    assert (status(stream).published, status(stream).dropped) == (2, {MALFORMED: 1, DOUBLED: 1})


@pytest.mark.parametrize("name", ["overlay/detection", "objects"])
def test_seq_counts_what_was_published(name: str) -> None:
    stream, make = streams()[name], RESULTS[name]
    taken = [take(stream, codec.encode(make(seq=seq))) for seq in (4, 9, 9, 12)]
    assert [message.header.seq for message in taken if message is not None] == [1, 2, 3]


@pytest.mark.parametrize(
    ("payload", "encoding", "reason"),
    [
        (b"", ENCODING, "not a ClassList"),
        (codec.encode(class_list()), "text/plain", "encoded as 'text/plain'"),
        (codec.encode(class_list(camera="rear")), ENCODING, "header says r1/rear, the key says r1/front"),
        (msgspec.msgpack.encode({"header": 1}), ENCODING, "not a ClassList"),
    ],
)
def test_a_malformed_result_costs_itself_only(
    stream: StreamReturn[ClassList], payload: bytes, encoding: str, reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert text(stream, class_list(seq=0)) == "[]"
    with caplog.at_level(logging.WARNING):
        assert stream.receive(payload, encoding, 0) is None
    assert f"{KEY}: result left out: {reason}" in caplog.text
    assert text(stream, class_list(seq=1)) == "[]"
    assert (status(stream).published, status(stream).dropped) == (2, {MALFORMED: 1})


def test_a_result_that_cannot_be_returned_does_not_hide_a_good_one_of_its_frame(
    stream: StreamReturn[ClassList],
) -> None:
    assert text(stream, class_list(("box", 2**62))) is None
    assert text(stream, class_list(("box", 1))) == "['box']"
    assert status(stream).dropped == {MALFORMED: 1}


def test_every_result_is_accounted_for(stream: StreamReturn[ClassList]) -> None:
    text(stream, class_list(seq=0))
    text(stream, class_list(seq=3), replaced=2)
    text(stream, class_list(seq=3))
    take(stream, b"")
    assert stream.status(wanted=False, subscribers=2, slow=4) == ReturnStatus(
        camera="front",
        stream="classes",
        topic="/ultralytics/detection/classes",
        wanted=False,
        subscribers=2,
        received=6,
        published=2,
        dropped={REPLACED: 2, DOUBLED: 1, MALFORMED: 1, SLOW: 4},
    )


def test_an_alert_is_returned_again_when_it_has_changed() -> None:
    stream = alerts_return("r1", IN_ROOT)
    sent = [alert(changed_ns=1), alert(changed_ns=1), alert(changed_ns=2), alert(id_="b"), alert(robot="r2")]
    assert [text(stream, each) is not None for each in sent] == [True, False, True, True, False]
    assert (status(stream).camera, status(stream).stream) == ("", "alerts")
    assert status(stream).dropped == {DOUBLED: 1, MALFORMED: 1}


def test_an_allowed_action_goes_to_its_topic_once(caplog: pytest.LogCaptureFixture) -> None:
    stream = actions_return("r1", {"pick_up": "/planner/pick_up", "stop": "/planner/stop"}, IN_ROOT)
    sent = [action(id_="1"), action(id_="1"), action(id_="2", name="stop"), action(id_="3", robot="r2")]
    with caplog.at_level(logging.WARNING):
        assert [text(stream, each) for each in sent] == ["box", None, "box", None]
        assert text(stream, action(id_="4", name="dance\n")) is None
        assert text(stream, action(id_="4", name="dance")) is None
    assert "fleet/r1/actions: 'dance' refused: the gateway's settings do not allow it" in caplog.text
    assert [stream.topic_of(each) for each in (sent[0], sent[2])] == ["/planner/pick_up", "/planner/stop"]
    assert status(stream).topic == "/planner/pick_up, /planner/stop"
    assert status(stream).dropped == {DOUBLED: 1, MALFORMED: 2, REFUSED: 1}


def test_without_settings_every_action_is_refused() -> None:
    stream = actions_return("r1", {}, IN_ROOT)
    assert text(stream, action()) is None
    assert (status(stream).topic, status(stream).published, status(stream).dropped) == ("", 0, {REFUSED: 1})


def test_an_action_that_nobody_heard_may_be_sent_again(caplog: pytest.LogCaptureFixture) -> None:
    stream = actions_return("r1", {"pick_up": "/planner/pick_up"}, IN_ROOT)
    payload = codec.encode(action())
    result = stream.receive(payload, codec.encoding(type(action())), 0)
    assert result is not None
    with caplog.at_level(logging.WARNING):
        stream.unheard(result)
    assert "fleet/r1/actions: nobody subscribes to /planner/pick_up" in caplog.text
    assert take(stream, payload) is not None
    assert (status(stream).published, status(stream).dropped) == (1, {UNHEARD: 1})


def test_what_was_replaced_for_slow_subscribers_is_counted_on() -> None:
    stream = actions_return("r1", {}, IN_ROOT)
    stream.retire(slow=2)
    stream.retire(slow=0)
    assert stream.status(wanted=False, subscribers=0, slow=3).dropped == {SLOW: 5}


def test_a_status_names_as_many_topics_as_it_can_carry() -> None:
    stream = actions_return("r1", {f"a{n}": f"/planner/{n:0100}" for n in range(9)}, IN_ROOT)
    assert len(status(stream).topic) == 256
