"""Garbage collections stay short, and garbage goes."""

import asyncio
import gc
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import TypeVar

import pytest

from services.monitor.event_loop.gc_tuning import FULL_GC_AFTER, GC_GEN0_THRESHOLD, LEAST, keep_collections_short

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
