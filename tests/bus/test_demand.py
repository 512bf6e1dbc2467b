import asyncio

from bus.demand import Demand


async def told(words: list[bool], *, initial: bool | None = None) -> list[bool]:
    """Return what is told after these words were heard within one turn of the loop."""
    heard: list[bool] = []
    demand = Demand(asyncio.get_running_loop(), heard.append)
    for word in words:
        demand.offer(wanted=word)
    if initial is not None:
        demand.offer(wanted=initial, initial=True)
    await asyncio.sleep(0)
    assert demand.wanted == (heard[-1] if heard else False)
    return heard


async def test_only_changes_are_told() -> None:
    assert await told([True]) == [True]
    assert await told([False]) == []
    assert await told([True, False]) == []
    assert await told([True, False, True]) == [True]


async def test_the_first_look_loses_against_what_was_heard() -> None:
    assert await told([], initial=True) == [True]
    assert await told([True], initial=False) == [True]
    assert await told([False], initial=True) == []


async def test_nothing_is_told_after_the_end() -> None:
    heard: list[bool] = []
    demand = Demand(asyncio.get_running_loop(), heard.append)
    demand.offer(wanted=True)
    demand.end()
    demand.offer(wanted=True)
    await asyncio.sleep(0)
    assert heard == []
    assert not demand.wanted


async def test_after_a_session_has_ended_a_first_look_counts_again() -> None:
    heard: list[bool] = []
    demand = Demand(asyncio.get_running_loop(), heard.append)
    demand.offer(wanted=True)
    await asyncio.sleep(0)
    demand.forget()
    await asyncio.sleep(0)
    demand.offer(wanted=True, initial=True)
    await asyncio.sleep(0)
    assert heard == [True, False, True]
