import asyncio
import threading

import pytest

from bus.delivery.inbox import Inbox, call_soon
from bus.delivery.mailbox import Fifo, PerKey


async def test_everything_that_many_threads_bring_is_taken_or_counted() -> None:
    inbox: Inbox[int] = Inbox(Fifo(50), asyncio.get_running_loop())

    def bring(key: str) -> None:
        for number in range(500):
            inbox.offer(key, number)

    threads = [threading.Thread(target=bring, args=[key]) for key in "abcd"]
    for thread in threads:
        thread.start()
    seen: dict[str, int] = {}
    taken = 0
    async with asyncio.timeout(60):
        while taken + inbox.dropped < 2000:
            try:
                async with asyncio.timeout(0.2):
                    item = await inbox.take()
            except TimeoutError:
                continue
            assert item.item > seen.get(item.key, -1)
            seen[item.key] = item.item
            taken += 1
    for thread in threads:
        thread.join()
    assert inbox.received == 2000
    assert taken + inbox.dropped == 2000


async def test_a_reader_that_is_busy_is_not_called() -> None:
    loop = CountingLoop()
    inbox: Inbox[int] = Inbox(PerKey(), loop)  # type: ignore[arg-type] # only what an inbox uses
    for number in range(5):
        inbox.offer("a", number)
    assert loop.calls == 0
    assert (await inbox.take()).item == 4
    waiting = asyncio.create_task(inbox.take())
    await asyncio.sleep(0)
    for number in range(5):
        inbox.offer("a", number)
    assert loop.calls == 1
    assert (await waiting).item == 4


class CountingLoop:
    """Counts what is called from other threads."""

    def __init__(self) -> None:
        self.calls = 0
        self._loop = asyncio.get_running_loop()
        self.create_future = self._loop.create_future

    def call_soon_threadsafe(self, callback: object) -> None:
        self.calls += 1
        assert callable(callback)
        self._loop.call_soon(callback)


async def test_an_inbox_that_has_ended_takes_nothing_in_and_gives_nothing_out() -> None:
    inbox: Inbox[int] = Inbox(PerKey(), asyncio.get_running_loop())
    inbox.offer("a", 1)
    inbox.end()
    inbox.offer("a", 2)
    assert inbox.received == 1
    with pytest.raises(StopAsyncIteration):
        await inbox.take()


def test_a_closed_loop_is_left_alone() -> None:
    loop = asyncio.new_event_loop()
    loop.close()
    call_soon(loop, lambda: pytest.fail("this must not be called"))
