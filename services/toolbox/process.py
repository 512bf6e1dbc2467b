"""Run one process: signals end it in order, within a deadline, and failures become one line and an exit code."""

import asyncio
import contextlib
import logging
import os
import signal
import sys
from collections.abc import Awaitable, Callable
from typing import Final

log = logging.getLogger(__name__)

EXIT_FAILED: Final = 1
EXIT_USAGE: Final = 2
DEADLINE_S: Final = 2.5
SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


def run(main: Callable[[], Awaitable[int | None]]) -> int:
    """Run `main` until it returns or a signal cancels it; return its exit code, 0 when a signal ended it in order.

    A process that has not ended DEADLINE_S after the first signal, or that gets a second one, is left at once.
    """
    with asyncio.Runner() as runner:
        return runner.run(_until_signalled(main))


async def _until_signalled(main: Callable[[], Awaitable[int | None]]) -> int:
    loop = asyncio.get_running_loop()
    work = asyncio.ensure_future(main())
    signalled = asyncio.Event()

    def stop(number: signal.Signals) -> None:
        if signalled.is_set():
            _leave(f"second {number.name}")
        signalled.set()
        loop.call_later(DEADLINE_S, _leave, f"not done {DEADLINE_S} s after {number.name}")
        work.cancel()

    for number in SIGNALS:
        loop.add_signal_handler(number, stop, number)
    try:
        return await work or 0
    except asyncio.CancelledError:
        if not signalled.is_set():
            raise
        return 0
    finally:
        for number in SIGNALS:
            loop.remove_signal_handler(number)


def _leave(why: str) -> None:
    log.error("leaving at once: %s", why)
    with contextlib.suppress(OSError):
        sys.stderr.flush()
    os._exit(EXIT_FAILED)
