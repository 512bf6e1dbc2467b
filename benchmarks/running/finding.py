"""Which benchmarks there are."""

from collections.abc import Collection, Iterable
from pathlib import Path


class UnknownBenchmarkError(Exception):
    """There is no benchmark of that name; the message says which there are."""


def names_in(folder: Path) -> list[str]:
    """Return the names of the packages in a folder that can be run."""
    return sorted(path.parent.name for path in folder.glob("*/__main__.py"))


def chosen(asked: Iterable[str], known: Collection[str]) -> list[str]:
    """Return what is asked for, each once and in that order, or everything if nothing is.

    Raises:
        UnknownBenchmarkError: one of them is not known.
    """
    names = list(dict.fromkeys(asked))
    for name in names:
        if name not in known:
            raise UnknownBenchmarkError(f"no benchmark is called {name!r}; there are {', '.join(sorted(known))}")
    return names or list(known)
