import threading
import time
from collections.abc import Iterator

import pytest

from bus.delivery.split_payload import Payload
from bus.delivery.writing import QUICK_S, QUICK_WRITES, Lane

PATIENCE_S = 60


class Clock:
    """A clock that only writing moves."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


class Recorder:
    """A writer that writes when its gate is open, and by the clock takes `takes_s` for it."""

    def __init__(self, *, fails: bool = False, clock: Clock | None = None, takes_s: float = 0.0) -> None:
        self.takes_s = takes_s
        self.threads: list[str] = []
        self._clock = clock or Clock()
        self.gate = threading.Event()
        self.gate.set()
        self.begun = threading.Event()
        self.written: list[bytes] = []
        self.dropped = 0
        self._fails = fails

    def write(self, payload: Payload) -> None:
        self.begun.set()
        assert self.gate.wait(PATIENCE_S)
        self.threads.append(threading.current_thread().name)
        self._clock.now += self.takes_s
        if self._fails:
            raise OSError("on purpose")
        self.written.append(bytes(payload))

    kept = 0

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


def test_so_many_wait_as_each_message_says_before_admission_and_after_it() -> None:
    lane, writer = Lane("test", depth=1), Recorder()
    lane.offer(writer, b"large")
    for payload in (b"1", b"2", b"3"):
        lane.offer(writer, payload, 3)
    lane.admit(writer)
    lane.retire(writer, PATIENCE_S)
    assert (writer.written, writer.dropped) == ([b"1", b"2", b"3"], 1)
    lane.offer(writer, b"4", 3)
    lane.offer(writer, b"larger")
    lane.admit(writer)
    lane.retire(writer, PATIENCE_S)
    lane.stop(PATIENCE_S)
    assert (writer.written[3:], writer.dropped) == ([b"larger"], 2)


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
    before = threading.enumerate()
    lane = Lane("unused", depth=1)
    assert threading.enumerate() == before
    lane.stop(0)


def offer_until(lane: Lane, writer: Recorder, thread: str) -> None:
    """Offer messages until one was written by the thread of that name."""
    begun, deadline = len(writer.threads), time.monotonic() + PATIENCE_S
    while thread not in writer.threads[begun:]:
        assert time.monotonic() < deadline
        lane.offer(writer, b"x")


@pytest.mark.parametrize("fails", [False, True])
def test_a_writer_that_is_quick_writes_at_once_until_it_is_slow(*, fails: bool) -> None:
    clock = Clock()
    lane = Lane("timed", depth=1, clock=clock)
    writer = Recorder(fails=fails, clock=clock)
    here = threading.current_thread().name
    lane.admit(writer)
    offer_until(lane, writer, here)
    *before, last = writer.threads
    assert (set(before), last) == ({"bus-timed"}, here)
    assert len(before) >= QUICK_WRITES
    writer.takes_s = QUICK_S
    lane.offer(writer, b"slow")
    lane.offer(writer, b"queued")
    lane.retire(writer, PATIENCE_S)
    lane.stop(PATIENCE_S)
    assert writer.threads[len(before) + 1 :] == [here, "bus-timed"]
    assert writer.written == [] if fails else writer.written[-2:] == [b"slow", b"queued"]


def test_a_link_that_turns_slow_holds_up_one_of_many_writers() -> None:
    clock = Clock()
    lane = Lane("timed", depth=1, clock=clock)
    here = threading.current_thread().name
    writers = [Recorder(clock=clock) for _ in range(20)]
    for writer in writers:
        lane.admit(writer)
        offer_until(lane, writer, here)
        writer.threads.clear()
    for writer in writers:
        writer.takes_s = QUICK_S
    for writer in writers:
        lane.offer(writer, b"slow")
    for writer in writers:
        lane.retire(writer, PATIENCE_S)
    lane.stop(PATIENCE_S)
    assert [writer.threads for writer in writers] == [[here]] + [["bus-timed"]] * 19


def test_a_stuck_writer_does_not_hold_up_a_quick_one(lane: Lane) -> None:
    stuck, quick = Recorder(), Recorder()
    lane.admit(quick)
    offer_until(lane, quick, threading.current_thread().name)
    stuck.gate.clear()
    lane.admit(stuck)
    lane.offer(stuck, b"stuck")
    assert stuck.begun.wait(PATIENCE_S)
    lane.offer(quick, b"free")
    assert quick.written[-1] == b"free"
    stuck.gate.set()
