import queue
import threading
from collections.abc import Sequence
from typing import Any

import zenoh

from bus.gathering import AT_ONCE, MAX_DECLARED, DeclaredKeys, Gathering
from tests.contract.waiting import PATIENCE_S


class Channel:
    """A channel of Zenoh's as far as it is read."""

    def __init__(self, waiting: int) -> None:
        self._items: queue.Queue[Any] = queue.Queue()
        self.put(*range(waiting))

    def put(self, *items: object) -> None:
        for item in items:
            self._items.put(item)

    def close(self) -> None:
        self._items.put(None)

    def recv(self) -> object:
        item = self._items.get()
        if item is None:
            self.close()
            raise zenoh.ZError("channel is empty and closed")
        return item

    def try_recv(self) -> object:
        return None if self._items.empty() else self.recv()


def test_what_waits_is_delivered_together_in_order_until_the_channel_is_closed() -> None:
    channel = Channel(AT_ONCE + 2)
    batches: list[Sequence[object]] = []
    whole = threading.Event()

    def deliver(samples: Sequence[object]) -> None:
        batches.append(samples)
        if len(batches) == 2:
            whole.set()

    gathering = Gathering(channel, deliver)
    assert whole.wait(PATIENCE_S)
    channel.put("the last")
    channel.close()
    gathering.join(PATIENCE_S)
    assert [list(batch) for batch in batches[:2]] == [list(range(AT_ONCE)), [AT_ONCE, AT_ONCE + 1]]
    assert batches[2:] == [["the last"]]


class Session:
    """A session as far as keys are declared on it."""

    def __init__(self) -> None:
        self.declared: list[str] = []

    def declare_keyexpr(self, key: str) -> None:
        self.declared.append(key)


def test_each_key_is_declared_once_and_no_more_than_there_is_room_for() -> None:
    session = Session()
    keys = DeclaredKeys(session, lambda act: act())  # type: ignore[arg-type] # only what is used of a session
    keys.declare(["a", "b", "a"])
    keys.declare(["b", *map(str, range(MAX_DECLARED))])
    assert session.declared == ["a", "b", *map(str, range(MAX_DECLARED - 2))]
