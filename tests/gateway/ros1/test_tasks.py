from __future__ import annotations

import asyncio

import pytest

from gateway.ros1.tasks import TaskScope, cancel_and_wait, to_the_end


async def forever() -> None:
    await asyncio.Event().wait()


async def test_leaving_cancels_the_tasks_and_waits_for_them() -> None:
    async with TaskScope() as scope:
        task = scope.start(forever(), "forever")
        await asyncio.sleep(0)
    assert task.cancelled()


async def test_error_of_the_body_stays_as_it_is() -> None:
    with pytest.raises(ValueError, match="mine"):  # noqa: PT012 - the block is what is tested
        async with TaskScope() as scope:
            scope.start(forever(), "forever")
            raise ValueError("mine")


async def test_failing_task_cancels_the_body() -> None:
    async def fail() -> None:
        raise ValueError("its")

    with pytest.raises(ExceptionGroup) as caught:  # noqa: PT012 - the block is what is tested
        async with TaskScope() as scope:
            scope.start(fail(), "fail")
            await forever()
    assert caught.group_contains(ValueError, match="its")


async def test_cancelling_from_outside_is_passed_on() -> None:
    inner: list[asyncio.Task[None]] = []

    async def body() -> None:
        async with TaskScope() as scope:
            inner.append(scope.start(forever(), "forever"))
            await forever()

    task = asyncio.ensure_future(body())
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert inner[0].cancelled()


async def test_cancel_and_wait_returns_when_all_have_ended() -> None:
    tasks = {asyncio.ensure_future(forever()) for _ in range(3)}
    await asyncio.sleep(0)
    await cancel_and_wait(tasks)
    assert all(task.cancelled() for task in tasks)
    await cancel_and_wait(set())


async def test_to_the_end_though_cancelled() -> None:
    go, done = asyncio.Event(), asyncio.Event()

    async def clean_up() -> None:
        await go.wait()
        done.set()

    task = asyncio.ensure_future(to_the_end(clean_up()))
    for _ in range(2):
        await asyncio.sleep(0)
        task.cancel()
    await asyncio.sleep(0)
    assert not task.done()
    go.set()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert done.is_set()


async def test_error_at_the_end_is_raised() -> None:
    async def fail() -> None:
        raise ValueError("its")

    with pytest.raises(ValueError, match="its"):
        await to_the_end(fail())
