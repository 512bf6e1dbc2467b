"""What may block for ever, beside the event loop."""

import asyncio
import contextlib
import threading
from collections.abc import Callable


async def aside(act: Callable[[], object]) -> None:
    """Do something on a thread of its own, which is left behind, and keeps no process alive, if this is cancelled."""
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
        except BaseException as error:  # noqa: BLE001 - it belongs to whoever waits
            failed = error
        with contextlib.suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(settle, failed)

    threading.Thread(target=run, name="aside", daemon=True).start()
    await done
