"""Cancels a coroutine after its n-th suspension, for every n until it ends by itself."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Coroutine, Generator


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
    make: Callable[[], Coroutine[Any, Any, None]], check: Callable[[int], Awaitable[None]], limit: int = 1000
) -> int:
    """Run `make()` once for each suspension, cancelled there, and `check(n)` after each; return how many there were."""
    for n in range(limit):
        stepped = _CancelAt(make(), n)
        task = asyncio.ensure_future(_run(stepped))
        await asyncio.wait([task])
        if task.cancelled():
            await check(n)
            continue
        task.result()
        await check(n)
        if not stepped.cancelled:
            return n
    raise AssertionError(f"still suspending after {limit}")


async def _run(stepped: _CancelAt) -> None:
    await stepped
