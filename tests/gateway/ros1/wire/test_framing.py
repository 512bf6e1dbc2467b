from __future__ import annotations

import struct

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gateway.ros1.errors import TcprosError, TooLargeError
from gateway.ros1.wire.framing import FIRST_STEP_BYTES, SCRATCH_BYTES, FrameBudget, FrameReceiver
from tests.gateway.ros1.wire.framed import feed, framed


@given(
    st.lists(st.integers(0, 3 * SCRATCH_BYTES) | st.integers(0, 5 * FIRST_STEP_BYTES), max_size=5),
    st.integers(1, 2 * SCRATCH_BYTES) | st.integers(1, 5 * FIRST_STEP_BYTES),
)
@example([FIRST_STEP_BYTES, FIRST_STEP_BYTES + 1, 2 * FIRST_STEP_BYTES, 2 * FIRST_STEP_BYTES + 1], FIRST_STEP_BYTES)
@example([SCRATCH_BYTES + 1] * 4 + [SCRATCH_BYTES], 5 * SCRATCH_BYTES)
@example([SCRATCH_BYTES + 1] * 3 + [SCRATCH_BYTES - 2, 0, 1, 2], 3)
@example([SCRATCH_BYTES + 1] * 3 + [5, SCRATCH_BYTES + 2, 5], SCRATCH_BYTES)
@example([3 * FIRST_STEP_BYTES] * 2 + [5, 3 * FIRST_STEP_BYTES], 3 * FIRST_STEP_BYTES + 4)
def test_frames_are_the_same_however_they_are_cut(sizes: list[int], piece: int) -> None:
    bodies = [bytes([i]) * size for i, size in enumerate(sizes)]
    stream = framed(*bodies)
    receiver = FrameReceiver(5 * FIRST_STEP_BYTES)
    frames = [
        frame for start in range(0, len(stream), piece) for frame in feed(receiver, stream[start : start + piece])
    ]
    assert frames == bodies


def test_frames_do_not_share_memory() -> None:
    first, second = feed(FrameReceiver(10), framed(b"one", b"two"))
    first[:] = b"xxx"
    assert bytes(second) == b"two"


def test_large_frame_is_received_into_a_buffer_of_its_size_once_there_was_one_like_it() -> None:
    size = 10 * FIRST_STEP_BYTES
    receiver = FrameReceiver(size)
    feed(receiver, framed(bytes(size // 2)))
    assert feed(receiver, struct.pack("<I", size)) == []
    assert len(receiver.get_buffer()) == size


def test_third_frame_of_a_size_is_received_where_it_stays() -> None:
    size = SCRATCH_BYTES + 1
    receiver = FrameReceiver(size)
    feed(receiver, framed(bytes(size)))
    assert len(receiver.get_buffer()) == SCRATCH_BYTES
    feed(receiver, framed(bytes(size)))
    buffer = receiver.get_buffer()
    assert len(buffer) == struct.calcsize("<I") + size
    buffer[:] = framed(b"x" * size)
    receiver.buffer_updated(len(buffer))
    frame = receiver.next_frame()
    assert frame is not None
    assert bytes(frame) == b"x" * size
    buffer[-1:] = b"y"
    assert frame[-1] == ord("y")


def test_memory_for_a_third_frame_of_a_size_is_let_go_when_another_comes() -> None:
    size = 2 * FIRST_STEP_BYTES
    budget = FrameBudget(3 * size)
    receiver = FrameReceiver(size, budget)
    feed(receiver, framed(bytes(size), bytes(size)))
    assert len(receiver.get_buffer()) == struct.calcsize("<I") + size
    assert budget.held_bytes == struct.calcsize("<I") + size
    assert feed(receiver, framed(b"short") + b"\x05\x00") == [b"short"]
    assert receiver.frame_under_way is None
    assert budget.held_bytes == 0
    assert len(receiver.get_buffer()) == SCRATCH_BYTES - 2


def test_third_frame_of_a_size_waits_for_its_length_where_there_is_no_budget() -> None:
    size = 2 * FIRST_STEP_BYTES
    receiver = FrameReceiver(size, FrameBudget(size))
    feed(receiver, framed(bytes(size), bytes(size)))
    assert len(receiver.get_buffer()) == SCRATCH_BYTES
    assert feed(receiver, framed(bytes(size))) == [bytes(size)]


def test_memory_for_frames_that_may_come_leaves_room_for_one_that_does() -> None:
    size = 4 * FIRST_STEP_BYTES
    budget = FrameBudget(2 * size)
    idle = [FrameReceiver(size, budget) for _ in range(3)]
    for receiver in idle:
        feed(receiver, framed(*[bytes(size // 2 - 4)] * 3))
        receiver.get_buffer()
    assert budget.held_bytes == size
    assert feed(FrameReceiver(size, budget), framed(bytes(size))) == [bytes(size)]


def test_announced_length_takes_no_memory() -> None:
    receiver = FrameReceiver(64 << 20)
    feed(receiver, struct.pack("<I", 64 << 20) + b"x")
    assert len(receiver.get_buffer()) == FIRST_STEP_BYTES - 1


@given(st.lists(st.integers(1, 1 << 20), min_size=1, max_size=20))
def test_buffer_grows_with_what_arrives(reads: list[int]) -> None:
    receiver = FrameReceiver(0xFFFFFFFF)
    feed(receiver, b"\xff\xff\xff\xff")
    arrived = 0
    for read in reads:
        free = len(receiver.get_buffer())
        assert 0 < free <= max(FIRST_STEP_BYTES, 2 * arrived) - arrived
        receiver.buffer_updated(min(read, free))
        arrived += min(read, free)
        assert receiver.next_frame() is None


def test_frame_of_the_largest_size_is_taken_and_one_byte_more_is_not() -> None:
    assert feed(FrameReceiver(5), framed(b"12345")) == [b"12345"]
    with pytest.raises(TcprosError, match="6 bytes, over the limit of 5"):
        feed(FrameReceiver(5), framed(b"123456"))


def test_a_message_over_the_cap_is_told_from_what_is_no_tcpros() -> None:
    receiver = FrameReceiver(5)
    receiver.of_messages = True
    with pytest.raises(TooLargeError, match="a message of 1,000 bytes, over the limit of 5") as caught:
        feed(receiver, framed(bytes(1_000)))
    assert (caught.value.size, caught.value.limit) == (1_000, 5)


def test_cap_is_checked_before_the_body_comes() -> None:
    with pytest.raises(TcprosError):
        feed(FrameReceiver(1 << 20), b"\xff\xff\xff\xff")


def test_frames_under_way_share_a_budget() -> None:
    size = 4 * FIRST_STEP_BYTES
    budget = FrameBudget(2 * size)
    first, second, third = (FrameReceiver(size, budget) for _ in range(3))
    for receiver in (first, second):
        assert feed(receiver, struct.pack("<I", size) + bytes(size - 1)) == []
    assert budget.held_bytes == 2 * size
    with pytest.raises(TcprosError, match=f"hold {2 * size} bytes"):
        feed(third, struct.pack("<I", size) + bytes(size))
    assert feed(first, b"x") == [bytes(size - 1) + b"x"]
    second.close()
    assert budget.held_bytes == 0
    assert feed(FrameReceiver(size, budget), framed(bytes(size))) == [bytes(size)]
    assert budget.held_bytes == 0


def test_small_frames_need_no_budget() -> None:
    receiver = FrameReceiver(1 << 20, FrameBudget(0))
    assert feed(receiver, framed(bytes(FIRST_STEP_BYTES))) == [bytes(FIRST_STEP_BYTES)]
    with pytest.raises(TcprosError):
        feed(receiver, framed(bytes(FIRST_STEP_BYTES + 1)))


def test_frame_under_way_is_numbered() -> None:
    receiver = FrameReceiver(1 << 20)
    assert receiver.frame_under_way is None
    feed(receiver, framed(b"a", b"b") + b"\x05\x00\x00\x00")
    assert receiver.frame_under_way == 2
    feed(receiver, b"1234")
    assert receiver.frame_under_way == 2
    feed(receiver, b"5")
    assert receiver.frame_under_way is None
    feed(receiver, b"\x05\x00\x00\x00")
    assert receiver.frame_under_way == 3
    receiver.close()
    assert receiver.frame_under_way is None
