"""How far all benchmarks are: bars on a terminal, plain lines elsewhere."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text


class Display(Protocol):
    """Shows what is done."""

    def begin(self, name: str) -> None:
        """Show which benchmark begins."""

    def says(self, line: str) -> None:
        """Show what the benchmark says of its progress."""

    def ended(self, outcome: str) -> None:
        """Show how the benchmark ended."""


class Lines:
    """A line for everything."""

    def __init__(self, console: Console, total: int) -> None:
        self._console = console
        self._total = total
        self._done = 0
        self._name = ""

    def begin(self, name: str) -> None:
        """Show which benchmark begins."""
        self._done += 1
        self._name = name
        self._print(f"[{self._done}/{self._total}] {name}")

    def says(self, line: str) -> None:
        """Show what the benchmark says of its progress."""
        self._print(f"  {self._name}: {line}")

    def ended(self, outcome: str) -> None:
        """Show how the benchmark ended."""
        self._print(f"  {self._name}: {outcome}")

    def _print(self, line: str) -> None:
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)


class Bars:
    """A bar of all benchmarks, a clock of the one that runs, with its last words; those that ended stand above."""

    def __init__(self, progress: Progress, every: TaskID, one: TaskID) -> None:
        self._progress = progress
        self._every = every
        self._one = one
        self._name = ""

    def begin(self, name: str) -> None:
        """Show which benchmark begins."""
        self._name = name
        self._progress.reset(self._one, description=name, total=None, words="")

    def says(self, line: str) -> None:
        """Show what the benchmark says of its progress."""
        self._progress.update(self._one, words=line)

    def ended(self, outcome: str) -> None:
        """Show how the benchmark ended."""
        self._progress.advance(self._every)
        self._progress.console.print(Text(f"{self._name}: {outcome}"))


@contextmanager
def display(console: Console, total: int) -> Iterator[Display]:
    """Show how far `total` benchmarks are."""
    if not console.is_terminal:
        yield Lines(console, total)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(20),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[words]}", markup=False),
    )
    with Progress(*columns, console=console) as progress:
        yield Bars(
            progress,
            progress.add_task("benchmarks", total=total, words=""),
            progress.add_task("", total=None, words=""),
        )
