"""The event loop stays responsive: turns, daemon threads, short garbage collections, cached values."""

import asyncio
import gc
import time
import weakref
from collections.abc import AsyncIterable, AsyncIterator, Callable, Iterator, Sequence
from contextlib import suppress
from typing import TypeVar

import pytest

from services.monitor import event_loop
from services.monitor.event_loop import (
    AT_ONCE,
    FULL_GC_AFTER,
    GC_GEN0_THRESHOLD,
    LEAST,
    TURN_S,
    CachedValue,
    arrivals_in_turns,
    in_turns,
    keep_collections_short,
    pause,
)


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
    monkeypatch.setattr(event_loop, "TURN_S", 60.0)
    assert await counted(in_turns(range(10))) == (10, 10)


async def test_who_waits_beside_many_arrivals_gets_its_turn() -> None:
    assert await counted(arrivals_in_turns(waiting())) == (AT_ONCE, 2 * AT_ONCE)


async def test_a_pause_lets_the_event_loop_wait_so_that_other_threads_run() -> None:
    paused = asyncio.ensure_future(pause())
    for _ in range(2):
        await asyncio.sleep(0)
    assert not paused.done()
    await paused


T = TypeVar("T")


class Knot:
    """Holds itself, so that only a collection frees it."""

    def __init__(self) -> None:
        self.itself = self


async def looked_at(sizes: Sequence[int], look: Callable[[], T]) -> list[T]:
    """Return what `look` says before there is each of so much, and once more after that."""
    rest, seen = iter(sizes), list[T]()

    def size() -> int:
        seen.append(look())
        return next(rest, 0)

    keeping = asyncio.create_task(keep_collections_short(size, period_s=0))
    async with asyncio.timeout(60):
        while len(seen) <= len(sizes):  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0)
    keeping.cancel()
    with suppress(asyncio.CancelledError):
        await keeping
    return seen[: len(sizes) + 1]


@pytest.fixture
def nothing_left_out() -> Iterator[None]:
    """The collected tests are left out (tests/conftest.py), but not here."""
    gc.unfreeze()
    yield
    gc.freeze()


@pytest.mark.usefixtures("nothing_left_out")
async def test_what_is_new_is_left_out_when_there_is_an_eighth_more_and_until_the_end() -> None:
    assert not gc.get_freeze_count()

    def left_out() -> bool:
        found = gc.get_freeze_count() > 0
        gc.unfreeze()
        return found

    sizes = [1, LEAST, 9 * LEAST // 8, 9 * LEAST // 8 + 1, 9 * LEAST // 8 + 1, 2 * LEAST]
    assert await looked_at(sizes, left_out) == [False, True, False, False, True, False, True]
    assert not gc.get_freeze_count()


@pytest.mark.usefixtures("nothing_left_out")
async def test_garbage_that_was_left_out_goes_when_there_is_twice_as_much() -> None:
    knots = [Knot()]
    remains = weakref.ref(knots[0])

    def is_there() -> bool:
        if gc.get_freeze_count():
            knots.clear()
        return remains() is not None

    assert await looked_at([1, LEAST * 3 // 2, 2 * LEAST - 1, 2 * LEAST], is_there) == [True, True, True, True, False]


@pytest.mark.usefixtures("nothing_left_out")
async def test_what_is_old_is_looked_at_after_so_many_looks_at_what_is_new() -> None:
    usual = gc.get_threshold()
    remains: list[weakref.ref[Knot]] = []

    def is_there() -> bool:
        if gc.get_freeze_count() and not remains:
            assert gc.get_threshold()[0] == GC_GEN0_THRESHOLD
            knot = Knot()
            remains.append(weakref.ref(knot))
            for _ in range(FULL_GC_AFTER):
                gc.collect(1)
        return any(each() is not None for each in remains)

    assert await looked_at([LEAST] * 3, is_there) == [False, True, False, False]
    assert gc.get_threshold() == usual


async def test_it_is_made_once_for_all_who_ask_and_again_when_it_is_old() -> None:
    made = 0

    async def make() -> int:
        nonlocal made
        await asyncio.sleep(0)
        made += 1
        return made

    kept, fresh = CachedValue(make, 60), CachedValue(make, -1)
    assert await asyncio.gather(*(kept.get() for _ in range(5))) == [1] * 5
    assert await kept.get() == 1
    assert [await fresh.get(), await fresh.get()] == [2, 3]


async def test_what_takes_little_is_made_anew_sooner() -> None:
    made = 0

    async def make() -> int:
        nonlocal made
        await asyncio.sleep(0.001)
        made += 1
        return made

    cheap, dear = CachedValue(make, 60, share=1_000_000), CachedValue(make, 60, share=0.000_001)
    assert [await cheap.get(), await cheap.get()] == [1, 2]
    assert [await dear.get(), await dear.get()] == [3, 3]


async def test_what_fails_is_tried_again() -> None:
    tries: Iterator[int | ValueError] = iter([ValueError("no"), 7])

    async def make() -> int:
        found = next(tries)
        if isinstance(found, Exception):
            raise found
        return found

    recent = CachedValue(make, 60)
    with pytest.raises(ValueError, match="no"):
        await recent.get()
    assert await recent.get() == 7


async def test_what_fails_fails_once_for_all_who_waited() -> None:
    tries = 0

    async def make() -> int:
        nonlocal tries
        tries += 1
        await asyncio.sleep(0)
        raise ValueError("no")

    recent = CachedValue(make, 60)
    found = await asyncio.gather(*(recent.get() for _ in range(5)), return_exceptions=True)
    assert ([str(each) for each in found], tries) == (["no"] * 5, 1)
