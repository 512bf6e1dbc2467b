"""Runs the demo's processes: started together, their output shown, all stopped at the end."""

import asyncio
import os
import shutil
import signal
import socket
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import ExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Final

STOP_S: Final = 1.5
"""Seconds for a process to stop in order before it is killed; with what follows it stays under 3 s."""

MAX_LINE: Final = 64 * 1024


OWN_SETTINGS: Final = ("FLEETSIGHT_", "ROS_")
"""The demo alone configures its processes, whatever the shell's environment says."""


class ChildFailedError(Exception):
    """A process ended that should run on; the message gives its name and its last output."""


@dataclass(slots=True)
class Child:
    """A running process. output: its stdout, complete once it has ended."""

    name: str
    process: Process
    last_words: str = ""
    output: list[str] = field(default_factory=list)
    readers: list[asyncio.Task[None]] = field(default_factory=list)

    async def ended(self) -> None:
        """Wait until the process has ended.

        Raises:
            ChildFailedError: always: nothing in the demo ends by itself.
        """
        code = await self.process.wait()
        await asyncio.gather(*self.readers)
        raise ChildFailedError(f"{self.name} ended with exit code {code}: {self.last_words or 'without output'}")


@asynccontextmanager
async def child(name: str, arguments: Sequence[str], say: Callable[[str], None]) -> AsyncIterator[Child]:
    """Run `fleetsight ARGUMENTS` while the context lasts; `say` gets each line it writes to stderr.

    It has a session of its own, so that a Ctrl-C reaches it through us alone, and it ends when we are killed.
    """
    watchdog = ["setpriv", "--pdeathsig", "TERM"] if shutil.which("setpriv") else []
    process = await asyncio.create_subprocess_exec(
        *watchdog,
        sys.executable,
        "-m",
        "fleetsight",
        *arguments,
        stdin=DEVNULL,
        stdout=PIPE,
        stderr=PIPE,
        limit=MAX_LINE,
        env={name: value for name, value in os.environ.items() if not name.startswith(OWN_SETTINGS)},
        start_new_session=True,
    )
    started = Child(name, process)
    started.readers = [asyncio.create_task(_read_errors(started, say)), asyncio.create_task(_read_output(started))]
    try:
        yield started
    finally:
        await _stop(started)


async def _stop(started: Child) -> None:
    process = started.process
    with suppress(ProcessLookupError):
        process.send_signal(signal.SIGTERM)
    try:
        async with asyncio.timeout(STOP_S):
            await process.wait()
    except TimeoutError:
        process.kill()
        await process.wait()
    await asyncio.gather(*started.readers)


async def _read_errors(started: Child, say: Callable[[str], None]) -> None:
    assert started.process.stderr is not None  # noqa: S101 - asked for with PIPE
    async for line in _lines(started.process.stderr):
        started.last_words = line
        say(f"{started.name}: {line}")


async def _read_output(started: Child) -> None:
    assert started.process.stdout is not None  # noqa: S101 - asked for with PIPE
    async for line in _lines(started.process.stdout):
        started.output.append(line)


async def _lines(stream: asyncio.StreamReader) -> AsyncIterator[str]:
    while True:
        try:
            line = await stream.readline()
        except ValueError:  # longer than MAX_LINE: the stream has dropped it
            continue
        if not line:
            return
        yield line.decode("utf-8", "replace").rstrip()


def free_ports(count: int) -> int:
    """Return the first of `count` consecutive free TCP ports of the loopback interface."""
    while True:
        with ExitStack() as stack, suppress(OSError, OverflowError):
            first = _bound(stack, 0)
            for port in range(first + 1, first + count):
                _bound(stack, port)
            return first


def _bound(stack: ExitStack, port: int) -> int:
    listening = stack.enter_context(socket.socket())
    listening.bind(("127.0.0.1", port))
    bound: int = listening.getsockname()[1]
    return bound
