import struct

import pytest

from gateway.ros1.image import TYPE_NAME
from gateway.ros1.messages import message_type
from gateway.ros1.tcpros.subscriber import Message
from gateway.ros1.wire.tcpros import PublisherAccepted
from gateway.to_bus.stream import MAX_PUBLISHERS, Gaps
from schemas.header import LONGEST_GAP


def numbered(seq: int, uri: str = "http://robot:1/", kind: str = TYPE_NAME, *, latching: bool = False) -> Message:
    said = PublisherAccepted("/camera", message_type(kind).topic_type, "", latching)
    return Message(struct.pack("<I", seq), uri, said)


def missing(*messages: Message) -> int:
    gaps = Gaps()
    for message in messages:
        gaps.arrived(message)
    return gaps.missing


@pytest.mark.parametrize(
    ("numbers", "count"),
    [
        ((5,), 0),
        ((5, 6, 7), 0),
        ((5, 8), 2),
        ((5, 5, 5), 0),
        ((9, 0, 1), 0),
        ((0, LONGEST_GAP + 1), LONGEST_GAP),
        ((0, LONGEST_GAP + 2), 0),
        ((0, 2**32 - 1), 0),
    ],
)
def test_numbers_that_did_not_arrive(numbers: tuple[int, ...], count: int) -> None:
    assert missing(*map(numbered, numbers)) == count


def test_publishers_count_by_themselves() -> None:
    assert missing(numbered(1, "a"), numbered(100, "b"), numbered(3, "a"), numbered(101, "b")) == 1


def test_latched_messages_and_other_types_have_no_numbers() -> None:
    assert missing(numbered(1, latching=True), numbered(5, latching=True)) == 0
    assert missing(numbered(1, kind="std_msgs/String"), numbered(5, kind="std_msgs/String")) == 0


def test_what_is_too_short_is_no_number() -> None:
    short = Message(b"\x01\x00\x00", "http://robot:1/", numbered(0).publisher)
    assert missing(numbered(1), short, numbered(2)) == 0


def test_a_pause_is_no_gap() -> None:
    gaps = Gaps()
    gaps.arrived(numbered(1))
    gaps.begin()
    gaps.arrived(numbered(9))
    gaps.arrived(numbered(11))
    assert gaps.missing == 1


def test_publishers_that_come_and_go_fill_no_memory() -> None:
    gaps = Gaps()
    for number in range(MAX_PUBLISHERS + 1):
        gaps.arrived(numbered(1, str(number)))
    gaps.arrived(numbered(5, "0"))
    gaps.arrived(numbered(5, str(MAX_PUBLISHERS)))
    assert gaps.missing == 3
