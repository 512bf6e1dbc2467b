import gc
import queue
import threading
import weakref
from collections.abc import Sequence
from typing import Any

import pytest
import zenoh

from bus.delivery.batching import (
    BYTES_AT_ONCE,
    GOOD_BATCH_SAMPLES,
    LONGEST_S,
    MAX_BATCH_SAMPLES,
    SHORTEST_S,
    Gathering,
    next_wait_s,
)
from tests.waiting import PATIENCE_S


class Channel:
    """A channel of Zenoh's as far as it is read."""

    def __init__(self, waiting: int) -> None:
        self._items: queue.Queue[Any] = queue.Queue()
        self.asked = threading.Semaphore(0)
        self.put(*range(waiting))

    def put(self, *items: object) -> None:
        for item in items:
            self._items.put(item)

    def close(self) -> None:
        self._items.put(None)

    def recv(self) -> object:
        self.asked.release()
        item = self._items.get()
        if item is None:
            self.close()
            raise zenoh.ZError("channel is empty and closed")
        return item

    def try_recv(self) -> object:
        return None if self._items.empty() else self.recv()


class Letter:
    """A sample."""


def test_what_waits_is_delivered_together_in_order_until_the_channel_is_closed() -> None:
    channel = Channel(MAX_BATCH_SAMPLES + 2)
    batches: list[Sequence[object]] = []
    whole = threading.Event()

    def deliver(samples: Sequence[object]) -> None:
        batches.append(samples)
        if len(batches) == 2:
            whole.set()

    gathering = Gathering(channel, deliver, size=lambda _: 1)
    assert whole.wait(PATIENCE_S)
    channel.put("the last")
    channel.close()
    gathering.join(PATIENCE_S)
    assert [list(batch) for batch in batches[:2]] == [
        list(range(MAX_BATCH_SAMPLES)),
        [MAX_BATCH_SAMPLES, MAX_BATCH_SAMPLES + 1],
    ]
    assert batches[2:] == [["the last"]]


def test_what_was_delivered_is_let_go_of_although_nothing_more_comes() -> None:
    channel = Channel(0)
    delivered = threading.Event()
    gathering = Gathering(channel, lambda _: delivered.set(), size=lambda _: 1)
    assert channel.asked.acquire(timeout=PATIENCE_S)
    letter = Letter()
    remains = weakref.ref(letter)
    channel.put(letter)
    del letter
    assert delivered.wait(PATIENCE_S)
    assert channel.asked.acquire(timeout=PATIENCE_S)
    gc.collect()
    assert remains() is None
    channel.close()
    gathering.join(PATIENCE_S)


def test_what_cannot_be_delivered_keeps_nothing_else_from_it(caplog: pytest.LogCaptureFixture) -> None:
    channel = Channel(0)
    taken: list[object] = []

    def deliver(samples: Sequence[object]) -> None:
        if "bad" in samples:
            raise ValueError("bad")
        taken.extend(samples)

    gathering = Gathering(channel, deliver, size=lambda _: 1)
    channel.put("bad")
    for _ in range(2):
        assert channel.asked.acquire(timeout=PATIENCE_S)
    channel.put("good")
    channel.close()
    gathering.join(PATIENCE_S)
    assert taken == ["good"]
    assert "not all of 1 messages were delivered" in caplog.text


@pytest.mark.parametrize(
    ("per_s", "wait_s"),
    [(1, LONGEST_S), (GOOD_BATCH_SAMPLES / LONGEST_S, LONGEST_S), (GOOD_BATCH_SAMPLES / 0.01, 0.01), (1e6, SHORTEST_S)],
)
def test_so_many_are_waited_for_but_never_long(per_s: float, wait_s: float) -> None:
    wait = SHORTEST_S
    for _ in range(20):
        wait = next_wait_s(wait, max(1, round(per_s * wait)))
    assert wait == pytest.approx(wait_s, rel=0.02)


def test_a_batch_ends_when_it_has_many_bytes() -> None:
    channel = Channel(8)
    sizes: list[int] = []
    whole = threading.Event()

    def deliver(samples: Sequence[object]) -> None:
        sizes.append(len(samples))
        if sum(sizes) == 8:
            whole.set()

    gathering = Gathering(channel, deliver, size=lambda _: BYTES_AT_ONCE // 3)
    assert whole.wait(PATIENCE_S)
    assert max(sizes) <= 4
    channel.close()
    gathering.join(PATIENCE_S)
