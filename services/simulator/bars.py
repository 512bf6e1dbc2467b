"""Progress of a long piece of work, on the terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


def bars(console: Console) -> Progress:
    """Return bars for any number of stages, to be entered."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
    )


@contextmanager
def bar(title: str, total: int) -> Iterator[Callable[[], None]]:
    """Show on stderr how much of `total` is done; what is yielded is called once for each piece."""
    with bars(Console(stderr=True)) as shown:
        task = shown.add_task(title, total=total)
        yield lambda: shown.advance(task)
