"""Waits for work that cannot be cancelled: abandons it on a daemon thread, or awaits its end."""

import asyncio
import contextlib
import threading
from collections.abc import Callable, Coroutine


async def in_daemon_thread(act: Callable[[], object]) -> None:
    """Run a function on its own daemon thread, which is abandoned on cancellation and never keeps the process alive."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()

    def settle(error: BaseException | None) -> None:
        if done.done():
            return
        if error is None:
            done.set_result(None)
        else:
            done.set_exception(error)

    def run() -> None:
        failed: BaseException | None = None
        try:
            act()
        except BaseException as error:  # noqa: BLE001 - it is raised where the result is awaited
            failed = error
        with contextlib.suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(settle, failed)

    threading.Thread(target=run, name="blocking-call", daemon=True).start()
    await done


async def uninterrupted(work: Coroutine[None, None, float]) -> float:
    """Await work to its end despite cancellation: an aborted statement may leave its database locked."""
    task = asyncio.ensure_future(work)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.wait([task])
        except asyncio.CancelledError as error:
            cancelled = error
    if cancelled is not None:
        raise cancelled from task.exception()
    return task.result()
