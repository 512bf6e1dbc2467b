import logging

import msgspec
import pytest

from gateway.outgoing.stream import DOUBLED, MALFORMED, REPLACED, SLOW, StreamReturn
from gateway.outgoing.translators import CLASSES, STRING
from gateway.ros1.messages import deserialise
from schemas import codec
from schemas.detections import ClassList
from schemas.keys import CameraKey
from schemas.status import ReturnStatus
from tests.gateway.outgoing.lists import class_list

ENCODING = codec.encoding(ClassList)
KEY = "fleet/r1/front/classes"


@pytest.fixture
def stream() -> StreamReturn[ClassList]:
    return StreamReturn(CameraKey("r1", "front"), "/ultralytics", CLASSES)


def take(stream: StreamReturn[ClassList], seen: ClassList, replaced: int = 0) -> str | None:
    message = stream.take(codec.encode(seen), ENCODING, replaced)
    return None if message is None else str(deserialise(STRING, message).data)


def status(stream: StreamReturn[ClassList]) -> ReturnStatus:
    return stream.status(wanted=True, subscribers=1, slow=0)


def test_a_class_list_goes_from_its_key_to_the_guides_topic(stream: StreamReturn[ClassList]) -> None:
    assert (stream.key, stream.topic) == (KEY, "/ultralytics/detection/classes")
    assert take(stream, class_list(("box", 2))) == "['box', 'box']"


@pytest.mark.parametrize(
    ("payload", "encoding", "reason"),
    [
        (b"", ENCODING, "not a ClassList"),
        (codec.encode(class_list()), "text/plain", "encoded as 'text/plain'"),
        (codec.encode(class_list(camera="rear")), ENCODING, "header says r1/rear, the key says r1/front"),
        (codec.encode(class_list(("box", 2**62), seq=1)), ENCODING, f"{2**62} objects in one image"),
        (msgspec.msgpack.encode({"header": 1}), ENCODING, "not a ClassList"),
    ],
)
def test_a_malformed_result_costs_itself_only(
    stream: StreamReturn[ClassList], payload: bytes, encoding: str, reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert take(stream, class_list(seq=0)) == "[]"
    with caplog.at_level(logging.WARNING):
        assert stream.take(payload, encoding, 0) is None
    assert f"{KEY}: result left out: {reason}" in caplog.text
    assert take(stream, class_list(seq=1)) == "[]"
    assert (status(stream).published, status(stream).dropped) == (2, {MALFORMED: 1})


def test_a_result_that_cannot_be_returned_does_not_hide_a_good_one_of_its_frame(
    stream: StreamReturn[ClassList],
) -> None:
    assert take(stream, class_list(("box", 2**62))) is None
    assert take(stream, class_list(("box", 1))) == "['box']"


def test_frames_only_go_forward_within_a_gateways_life(stream: StreamReturn[ClassList]) -> None:
    frames = [("a", 5), ("a", 5), ("a", 6), ("a", 5), ("b", 0), ("b", 0), ("b", 1)]
    taken = [take(stream, class_list(boot_id=boot, seq=seq)) is not None for boot, seq in frames]
    assert taken == [True, False, True, False, True, False, True]
    assert status(stream).dropped == {DOUBLED: 3}


def test_every_result_is_accounted_for(stream: StreamReturn[ClassList]) -> None:
    take(stream, class_list(seq=0))
    take(stream, class_list(seq=3), replaced=2)
    take(stream, class_list(seq=3))
    stream.take(b"", ENCODING, 0)
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
