"""One run of one benchmark: a process of its own, bounded in time, that leaves nothing behind."""

import asyncio
import json
import os
import signal
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Final

END_S: Final = 10.0

LAST_LINES: Final = 5
MAX_LINE: Final = 1 << 16


class BenchmarkError(Exception):
    """A benchmark found nothing; the message says why."""


async def run(
    command: Sequence[str], limit_s: float, say: Callable[[str], None], *, end_s: float = END_S
) -> dict[str, Any]:
    """Run a benchmark and return the JSON object that it prints. say: gets each line of its progress.

    end_s: how long one that is ended may take to end its own processes.

    Raises:
        BenchmarkError: it failed, took longer than `limit_s`, or printed something else.
    """
    process = await asyncio.create_subprocess_exec(
        *command, stdin=DEVNULL, stdout=PIPE, stderr=PIPE, limit=MAX_LINE, start_new_session=True
    )
    said: list[str] = []
    try:
        async with asyncio.timeout(limit_s):
            printed, _, code = await asyncio.gather(_read(process), _relay(process, said, say), process.wait())
    except TimeoutError as error:
        raise BenchmarkError(f"not done after {limit_s:g} s") from error
    finally:
        await _end(process, end_s)
    if code:
        raise BenchmarkError(f"exit code {code}: {' | '.join(said) or 'it said nothing'}")
    return _object(printed)


def _object(printed: bytes) -> dict[str, Any]:
    try:
        found = json.loads(printed)
    except ValueError as error:
        raise BenchmarkError(f"what it printed is no JSON: {printed[:80]!r}") from error
    if not isinstance(found, dict):
        raise BenchmarkError(f"what it printed is no JSON object: {printed[:80]!r}")
    return found


async def _read(process: Process) -> bytes:
    assert process.stdout is not None  # noqa: S101 - asked for with PIPE
    return await process.stdout.read()


async def _relay(process: Process, said: list[str], say: Callable[[str], None]) -> None:
    assert process.stderr is not None  # noqa: S101 - asked for with PIPE
    while True:
        try:
            read = await process.stderr.readline()
        except ValueError:  # longer than MAX_LINE: the stream has dropped it
            continue
        if not read:
            return
        if line := read.decode(errors="replace").strip():
            said[:] = [*said[1 - LAST_LINES :], line]
            say(line)


async def _end(process: Process, end_s: float) -> None:
    """End a benchmark in order, then whatever is left of its processes."""
    if process.returncode == 0:
        return
    with suppress(ProcessLookupError):
        process.terminate()
    with suppress(TimeoutError):
        async with asyncio.timeout(end_s):
            await process.wait()
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    await process.wait()
