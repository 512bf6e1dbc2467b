"""Cancels a coroutine after its n-th suspension, for every n until it ends by itself; nothing may be left."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tests.waiting import until

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Coroutine, Generator

    from gateway.ros1.node import Node

LIMIT = 1000


class _CancelAt:
    """Steps a coroutine and throws CancelledError into it at its n-th suspension."""

    def __init__(self, coroutine: Coroutine[Any, Any, None], n: int) -> None:
        self._coroutine = coroutine
        self._left = n
        self.cancelled = False

    def __await__(self) -> Generator[Any, Any, None]:
        step = self._coroutine.__await__()
        send = step.__next__
        while True:
            try:
                waited_for = send()
            except StopIteration:
                return
            if self._left == 0 and not self.cancelled:
                self.cancelled = True
                task = asyncio.current_task()
                assert task is not None
                asyncio.get_running_loop().call_soon(task.cancel)
            self._left -= 1
            try:
                value = yield waited_for
            except BaseException as error:  # noqa: BLE001 - all of it belongs to the coroutine
                send = _thrower(step, error)
            else:
                send = _sender(step, value)


def _thrower(step: Generator[Any, Any, None], error: BaseException) -> Callable[[], Any]:
    return lambda: step.throw(error)


def _sender(step: Generator[Any, Any, None], value: Any) -> Callable[[], Any]:
    return lambda: step.send(value)


def open_sockets() -> set[str]:
    """Return the kernel's names of this process's open sockets."""
    names = set()
    for descriptor in Path("/proc/self/fd").iterdir():
        try:
            name = str(descriptor.readlink())
        except OSError:
            continue
        if name.startswith("socket:"):
            names.add(name)
    return names


async def cancel_everywhere(
    make: Callable[[], Coroutine[Any, Any, None]],
    check: Callable[[int], Awaitable[None]] | None = None,
    *,
    sockets: bool = False,
) -> int:
    """Run `make()` once for each suspension, cancelled there, and `check(n)` after each; return how many there were.

    No task is left after any of them that was not there before, and if so asked no more sockets.
    """
    tasks, most = asyncio.all_tasks(), len(open_sockets())
    for n in range(LIMIT):
        stepped = _CancelAt(make(), n)
        task = asyncio.ensure_future(_run(stepped))
        await asyncio.wait([task])
        if not task.cancelled():
            task.result()
        if check is not None:
            await check(n)
        await until(lambda: asyncio.all_tasks() <= tasks, f"no task is left after {n}")
        if sockets:
            await until(lambda: len(open_sockets()) <= most, f"no socket is left after {n}")
        if not stepped.cancelled:
            return n
    raise AssertionError(f"still suspending after {LIMIT}")


async def nothing_registered(watch: Node, n: int) -> None:
    """Check that a master knows of no publisher and no subscriber after `n` suspensions."""
    state = await watch.master.get_system_state()
    assert (state.publishers, state.subscribers) == ({}, {}), n


async def _run(stepped: _CancelAt) -> None:
    await stepped
