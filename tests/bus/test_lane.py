import threading
from collections.abc import Iterator

import pytest

from bus.lane import Lane

PATIENCE_S = 10


class Recorder:
    """A writer that writes when its gate is open."""

    def __init__(self, *, fails: bool = False) -> None:
        self.gate = threading.Event()
        self.gate.set()
        self.begun = threading.Event()
        self.written: list[bytes] = []
        self.dropped = 0
        self._fails = fails

    def write(self, payload: bytes | bytearray) -> None:
        self.begun.set()
        assert self.gate.wait(PATIENCE_S)
        if self._fails:
            raise OSError("on purpose")
        self.written.append(bytes(payload))

    def count_dropped(self, number: int) -> None:
        self.dropped += number


@pytest.fixture
def lane() -> Iterator[Lane]:
    lane = Lane("test", depth=2)
    yield lane
    lane.stop(PATIENCE_S)
    assert "bus-test" not in [thread.name for thread in threading.enumerate()]


def test_messages_wait_for_admission_and_the_oldest_go_first(lane: Lane) -> None:
    writer = Recorder()
    for payload in (b"1", b"2", b"3"):
        lane.offer(writer, payload)
    assert (writer.written, writer.dropped) == ([], 1)
    lane.admit(writer)
    lane.retire(writer, PATIENCE_S)
    assert (writer.written, writer.dropped) == ([b"2", b"3"], 1)


def test_a_writer_that_is_stuck_loses_its_oldest_and_retires_without_the_rest(lane: Lane) -> None:
    writer = Recorder()
    writer.gate.clear()
    lane.admit(writer)
    lane.offer(writer, b"stuck")
    assert writer.begun.wait(PATIENCE_S)
    for payload in (b"1", b"2", b"3"):
        lane.offer(writer, payload)
    assert writer.dropped == 1
    lane.retire(writer, 0)
    assert writer.dropped == 3
    writer.gate.set()
    lane.stop(PATIENCE_S)
    assert writer.written == [b"stuck"]


def test_a_message_that_cannot_be_written_is_counted_and_harms_nobody_else(lane: Lane) -> None:
    broken, healthy = Recorder(fails=True), Recorder()
    lane.admit(broken)
    lane.admit(healthy)
    lane.offer(broken, b"x")
    lane.offer(healthy, b"y")
    lane.retire(broken, PATIENCE_S)
    lane.retire(healthy, PATIENCE_S)
    assert (broken.written, broken.dropped) == ([], 1)
    assert (healthy.written, healthy.dropped) == ([b"y"], 0)


def test_a_retired_writer_is_not_written_to(lane: Lane) -> None:
    writer = Recorder()
    lane.admit(writer)
    lane.retire(writer, PATIENCE_S)
    lane.offer(writer, b"late")
    lane.stop(PATIENCE_S)
    assert writer.written == []


def test_a_lane_that_nobody_used_has_no_thread() -> None:
    Lane("unused", depth=1).stop(0)
