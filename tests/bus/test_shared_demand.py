import asyncio

import pytest

from bus.demand import SharedDemand, while_wanted


async def settle() -> None:
    for _ in range(10):
        await asyncio.sleep(0)


async def test_wanted_while_any_publisher_is() -> None:
    demand = SharedDemand()
    first, second = demand.of("first"), demand.of("second")
    assert not demand.wanted
    first(True)  # noqa: FBT003 - the bus calls it so
    second(True)  # noqa: FBT003
    first(False)  # noqa: FBT003
    assert demand.wanted
    second(False)  # noqa: FBT003
    assert not demand.wanted


async def test_work_runs_while_wanted_and_is_cleaned_up_after() -> None:
    demand, seen = SharedDemand(), []

    async def work() -> None:
        seen.append("begun")
        try:
            await asyncio.Event().wait()
        finally:
            seen.append("ended")

    running = asyncio.create_task(while_wanted(demand, work))
    await settle()
    assert seen == []
    tell = demand.of("only")
    for wanted in (True, False, True):
        tell(wanted)
        await settle()
    assert seen == ["begun", "ended", "begun"]
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    assert seen == ["begun", "ended", "begun", "ended"]


async def test_a_change_and_back_before_anybody_looks_changes_nothing() -> None:
    demand, begun = SharedDemand(), 0

    async def work() -> None:
        nonlocal begun
        begun += 1
        await asyncio.Event().wait()

    running = asyncio.create_task(while_wanted(demand, work))
    tell = demand.of("only")
    tell(True)  # noqa: FBT003
    tell(False)  # noqa: FBT003
    await settle()
    assert begun <= 1
    tell(True)  # noqa: FBT003
    await settle()
    assert demand.wanted
    assert begun >= 1
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running


async def test_work_that_fails_ends_it_all() -> None:
    demand = SharedDemand()

    async def work() -> None:
        raise RuntimeError("broken")

    demand.of("only")(True)  # noqa: FBT003
    with pytest.raises(ExceptionGroup) as caught:
        await while_wanted(demand, work)
    assert isinstance(caught.value.exceptions[0], RuntimeError)


class Counting:
    """Work that counts how often it was begun and ended."""

    def __init__(self) -> None:
        self.begun = 0
        self.ended = asyncio.Event()

    async def __call__(self) -> None:
        self.begun += 1
        try:
            await asyncio.Event().wait()
        finally:
            self.ended.set()


async def test_work_that_lingers_lives_on_through_a_demand_that_blinks() -> None:
    demand, work = SharedDemand(), Counting()
    running = asyncio.create_task(while_wanted(demand, work, linger_s=1000))
    tell = demand.of("only")
    for wanted in (True, False, True, False, True, False):
        tell(wanted)
        await settle()
        assert demand.wanted is wanted
    assert work.begun == 1
    assert not work.ended.is_set()
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    assert work.ended.is_set()


async def test_work_that_lingers_ends_when_nobody_came_back_and_begins_at_once_when_somebody_does() -> None:
    demand, work = SharedDemand(), Counting()
    running = asyncio.create_task(while_wanted(demand, work, linger_s=0.01))
    tell = demand.of("only")
    for begun in (1, 2):
        work.ended.clear()
        tell(True)  # noqa: FBT003
        await settle()
        assert work.begun == begun
        tell(False)  # noqa: FBT003
        async with asyncio.timeout(60):
            await work.ended.wait()
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
