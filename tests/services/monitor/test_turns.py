import asyncio
from collections.abc import AsyncIterable, AsyncIterator

import pytest

from services.monitor.turns import AT_ONCE, arrivals_in_turns, in_turns, pause


async def waiting() -> AsyncIterator[int]:
    """What is there already."""
    for number in range(2 * AT_ONCE):
        yield number


@pytest.mark.parametrize(
    "items", [in_turns(range(2 * AT_ONCE)), arrivals_in_turns(waiting())], ids=["items", "arrivals"]
)
async def test_others_get_their_turn_now_and_then(items: AsyncIterable[int]) -> None:
    done: list[int] = []
    seen: list[int] = []
    asyncio.get_running_loop().call_soon(lambda: seen.append(len(done)))
    async for item in items:
        done.append(item)  # noqa: PERF401 - how many there are meanwhile is what is looked at
    assert (done, seen) == (list(range(2 * AT_ONCE)), [AT_ONCE])


async def test_a_pause_lets_the_event_loop_wait_so_that_other_threads_run() -> None:
    paused = asyncio.ensure_future(pause())
    for _ in range(2):
        await asyncio.sleep(0)
    assert not paused.done()
    await paused


async def test_fewer_at_once_are_more_turns() -> None:
    done: list[int] = []
    seen: list[int] = []
    asyncio.get_running_loop().call_soon(lambda: seen.append(len(done)))
    async for item in in_turns(range(10), 3):
        done.append(item)  # noqa: PERF401 - how many there are meanwhile is what is looked at
    assert (done, seen) == (list(range(10)), [3])
