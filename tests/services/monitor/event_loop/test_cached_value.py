"""Values that are made once for all who ask."""

import asyncio
from collections.abc import Iterator

import pytest

from services.monitor.event_loop.cached_value import CachedValue


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
