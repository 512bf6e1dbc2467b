"""Long work lets others have their turn."""

import asyncio
import time
from collections.abc import AsyncIterable, AsyncIterator

import pytest

from services.monitor.event_loop import cooperative_yielding
from services.monitor.event_loop.cooperative_yielding import AT_ONCE, TURN_S, arrivals_in_turns, in_turns, pause


async def waiting() -> AsyncIterator[int]:
    """What is there already."""
    for number in range(2 * AT_ONCE):
        yield number


async def counted(items: AsyncIterable[int], *, each_s: float = 0.0) -> tuple[int, int]:
    """How many items were done when others first had their turn, and how many there are."""
    done: list[int] = []
    seen: list[int] = []
    asyncio.get_running_loop().call_soon(lambda: seen.append(len(done)))
    async for item in items:
        time.sleep(each_s)  # noqa: ASYNC251 - work that keeps the event loop
        done.append(item)
    await asyncio.sleep(0)
    assert done == list(range(len(done)))
    return seen[0], len(done)


async def test_who_waits_beside_long_work_gets_its_turn_soon() -> None:
    assert await counted(in_turns(range(3)), each_s=1.1 * TURN_S) == (1, 3)


async def test_short_work_is_done_in_one_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cooperative_yielding, "TURN_S", 60.0)
    assert await counted(in_turns(range(10))) == (10, 10)


async def test_who_waits_beside_many_arrivals_gets_its_turn() -> None:
    assert await counted(arrivals_in_turns(waiting())) == (AT_ONCE, 2 * AT_ONCE)


async def test_a_pause_lets_the_event_loop_wait_so_that_other_threads_run() -> None:
    paused = asyncio.ensure_future(pause())
    for _ in range(2):
        await asyncio.sleep(0)
    assert not paused.done()
    await paused
