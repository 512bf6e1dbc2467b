import asyncio

import pytest

from services.monitor.live_views.shared import CrowdedError, SharedSubscriptions


class Following:
    """What is followed now, and how often it began."""

    def __init__(self) -> None:
        self.now: list[str] = []
        self.begun = 0

    async def __call__(self, key: str, state: list[str]) -> None:
        state.append(key)
        self.now.append(key)
        self.begun += 1
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(0)  # as an undeclaration takes time
            self.now.remove(key)


async def settle() -> None:
    for _ in range(3):
        await asyncio.sleep(0)


async def test_it_begins_with_the_first_and_ends_with_the_last() -> None:
    following = Following()
    shared = SharedSubscriptions[str, list[str]](lambda _: [], following, most=2)
    async with shared.hold("a") as one:
        async with shared.hold("a") as two:
            await settle()
            assert one is two is shared.peek("a")
            assert one == ["a"]
        assert (following.now, following.begun, shared.keys) == (["a"], 1, ["a"])
    assert (following.now, shared.keys, shared.peek("a")) == ([], [], None)
    async with shared.hold("a") as again:
        await settle()
        assert again == ["a"]
        assert again is not one


async def test_a_viewer_that_is_cancelled_leaves() -> None:
    following = Following()

    async def look(shared: SharedSubscriptions[str, list[str]]) -> None:
        async with shared.hold("a"):
            await asyncio.Event().wait()

    shared = SharedSubscriptions[str, list[str]](lambda _: [], following, most=2)
    viewer = asyncio.create_task(look(shared))
    await settle()
    assert following.now == ["a"]
    viewer.cancel()
    await asyncio.wait([viewer])
    assert following.now == []


async def test_no_more_than_so_many_are_held_at_once() -> None:
    shared = SharedSubscriptions[str, list[str]](lambda _: [], Following(), most=1)
    async with shared.hold("a"), shared.hold("a"):
        with pytest.raises(CrowdedError, match="1 are already open"):
            async with shared.hold("b"):
                pass
    async with shared.hold("b"):
        assert shared.keys == ["b"]


async def test_what_ends_the_following_is_raised_to_who_leaves_last() -> None:
    async def fail(_: str, __: None) -> None:
        raise ValueError("no such thing")

    shared = SharedSubscriptions[str, None](lambda _: None, fail, most=1)
    with pytest.raises(ValueError, match="no such thing"):
        async with shared.hold("a"):
            await settle()
    assert shared.keys == []
