"""Shows the progress of long work: bars on a terminal, otherwise an occasional line."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import Final

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

Report = Callable[[str, int, int], None]
"""Called as `report(stage, done, total)`, from one thread; `done` counts up to `total` within each stage."""

EVERY_S: Final = 15.0
"""Seconds between two lines about the same stage."""


class Lines:
    """Writes a line when a stage begins, every `EVERY_S` and when it is done."""

    def __init__(self, console: Console, clock: Callable[[], float] = time.monotonic) -> None:
        self._console = console
        self._clock = clock
        self._stage = ""
        self._began = (0.0, 0)
        self._next_s = 0.0

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Write the stage's progress if a line is due."""
        now = self._clock()
        if stage != self._stage:
            self._stage, self._began = stage, (now, done)
        elif now < self._next_s and done < total:
            return
        self._next_s = now + EVERY_S
        line = f"{stage}: {done} of {total}{self._times(done, total, now)}"
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)

    def _times(self, done: int, total: int, now: float) -> str:
        began_s, first = self._began
        if done == first:
            return ""
        took_s = now - began_s
        left_s = took_s * (total - done) / (done - first)
        return f" after {_clocked(took_s)}" + (f", {_clocked(left_s)} to go" if done < total else "")


def _clocked(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))


@contextmanager
def progress(console: Console) -> Iterator[Report]:
    """Show the progress of any number of stages on the console while the context lasts."""
    if not console.is_terminal:
        yield Lines(console)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console) as shown:
        stages: dict[str, TaskID] = {}

        def report(stage: str, done: int, total: int) -> None:
            if stage not in stages:
                stages[stage] = shown.add_task(stage, total=total)
            shown.update(stages[stage], completed=done, total=total)

        yield report


@contextmanager
def bar(title: str, total: int) -> Iterator[Callable[[], None]]:
    """Show on stderr how much of `total` is done; call the yielded function once per piece."""
    with progress(Console(stderr=True)) as report:
        done = 0

        def advance() -> None:
            nonlocal done
            done += 1
            report(title, done, total)

        report(title, 0, total)
        yield advance
