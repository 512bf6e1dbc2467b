from __future__ import annotations

import pytest

from gateway.ros1.errors import MessageError
from gateway.ros1.messages import deserialise, message_type
from gateway.ros1.sim_clock import TYPE_NAME, SimClock, decode_clock


def test_only_a_step_back_is_a_jump() -> None:
    clock = SimClock()
    assert [clock.tell(now) for now in (5, 5, 6, 2, 3, 0)] == [False, False, False, True, False, True]
    assert (clock.now_ns, clock.jumps) == (0, 2)


def test_ros_time_is_its_own_only_while_it_is_used() -> None:
    clock = SimClock()
    clock.tell(7)
    assert clock.ros_time_ns is None
    clock.used = True
    assert clock.ros_time_ns == 7


def test_a_clock_message_is_seconds_and_nanoseconds_without_a_sign() -> None:
    data = b"\xff\xff\xff\xff\x07\x00\x00\x00"
    assert decode_clock(bytearray(data)) == (2**32 - 1) * 1_000_000_000 + 7
    assert deserialise(TYPE_NAME, data).clock.nanosec == 7
    assert message_type(TYPE_NAME).md5sum == "a9c97c1d230cfc112e270351a944ee47"


@pytest.mark.parametrize("size", [0, 7, 9])
def test_bytes_that_are_no_clock(size: int) -> None:
    with pytest.raises(MessageError):
        decode_clock(bytes(size))
