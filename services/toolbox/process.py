"""Runs one process: signals stop it in order, within a deadline, and failures become one line and an exit code."""

import asyncio
import contextlib
import logging
import os
import signal
import sys
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final, NoReturn, TextIO

from services import service_manager

log = logging.getLogger(__name__)

EXIT_FAILED: Final = 1
EXIT_USAGE: Final = 2
DEADLINE_S: Final = 2.5
FLUSH_S: Final = 1.0
ECHO_S: Final = 0.1
"""A signal that comes so soon after the first is the same one: `timeout` sends each to its child, and to its group."""

SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)
INTERRUPTED: Final = 128
"""The offset that shells add to the number of a signal that ended a program."""


def run(main: Callable[[], Awaitable[int | None]], *, finite: bool = False) -> int:
    """Run `main` until it returns or a signal cancels it; return its exit code.

    finite: it has an end of its own; a signal that ends it before makes the code INTERRUPTED and the signal's number.
    A process that runs until stopped has then ended normally, with 0. Closing the terminal also stops it, unless SIGHUP
    is ignored (nohup).

    A process that has not ended DEADLINE_S after the first signal, or that gets a second one, is left at once. Once a
    signal has ended `main`, nobody waits for its threads: `main` itself has waited for anything that is to be saved.
    A slow reader of the output of `main` is waited for, unless a signal ended it. systemd is told that it runs, and
    while its event loop turns.
    """
    with asyncio.Runner() as runner:
        code = runner.run(_until_signalled(main))
    if isinstance(code, signal.Signals):
        return INTERRUPTED + code if finite else 0
    return written(code)


def written(code: int) -> int:
    """Return an exit code once the output is flushed; EXIT_FAILED, with the reason on stderr, if it cannot be.

    A reader that closed the output early is not an error.
    """
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        return code
    except OSError as error:
        return lost(error)
    return code


def lost(error: OSError) -> int:
    """Print on stderr why the output cannot be written; return EXIT_FAILED."""
    sys.stderr.write(f"fleetsight: the output cannot be written: {error.strerror}\n")
    return EXIT_FAILED


async def _until_signalled(main: Callable[[], Awaitable[int | None]]) -> int | signal.Signals:
    """Return the exit code of `main`, or the signal that ended it."""
    loop = asyncio.get_running_loop()
    work = asyncio.ensure_future(main())
    reporting = asyncio.create_task(service_manager.report())
    beating = asyncio.create_task(service_manager.touch_heartbeat())
    ended_by: signal.Signals | None = None
    signalled_s = 0.0

    def stop(number: signal.Signals) -> None:
        nonlocal ended_by, signalled_s
        if ended_by is None:
            ended_by, signalled_s = number, loop.time()
            loop.call_later(DEADLINE_S, _give_up, f"not stopped {DEADLINE_S} s after {number.name}")
            work.cancel()
            reporting.cancel()
        elif loop.time() - signalled_s > ECHO_S:
            _give_up(f"second {number.name}")

    before = {number: signal.getsignal(number) for number in SIGNALS}
    if (on_hangup := signal.getsignal(signal.SIGHUP)) is not signal.SIG_IGN:
        before[signal.SIGHUP] = on_hangup
    for number in before:
        loop.add_signal_handler(number, stop, number)
    failed = True
    try:
        code = await work or 0
    except asyncio.CancelledError:
        if ended_by is None:
            raise
        loop.set_default_executor(ThreadPoolExecutor(1))  # closing the loop waits for this executor's threads only
        failed = False
        return ended_by
    else:
        failed = False
        return code
    finally:
        reporting.cancel()
        beating.cancel()
        for number, handler in before.items():
            loop.remove_signal_handler(number)
            signal.signal(number, _leave_failed if failed else handler)


def _leave_failed(_number: int, _frame: object) -> NoReturn:
    """A failure counts even if a signal arrives while it is handled."""
    os._exit(EXIT_FAILED)


def leave(code: int) -> NoReturn:
    """End the process with an exit code. Everything of ours is closed by now; torch would take a second to exit.

    Last words that nobody reads are given up.
    """
    flushing = threading.Thread(target=_flush_all, daemon=True)
    flushing.start()
    flushing.join(FLUSH_S)
    os._exit(code)


def _flush_all() -> None:
    logging.shutdown()
    for stream in (sys.stdout, sys.stderr):
        _flush(stream)


def _flush(stream: TextIO) -> None:
    with contextlib.suppress(OSError, ValueError):
        stream.flush()


def _give_up(why: str) -> NoReturn:
    log.error("exiting at once: %s", why)
    leave(EXIT_FAILED)
