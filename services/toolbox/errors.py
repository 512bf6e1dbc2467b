"""Errors of how a command was called. Pure."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Final


class UsageError(Exception):
    """A setting is wrong; the message names it and fits on one line."""


LIKENESS: Final = 0.8
"""Minimum similarity of two names by difflib: one letter more, less or different in five to ten."""


def meant(name: str, known: Iterable[str], prefix: str = "") -> str:
    """Return the end of a sentence that suggests the nearest known name; empty if none is near.

    prefix: what `name` begins with and the known ones are written with.
    """
    near = get_close_matches(name.removeprefix(prefix), list(known), n=1, cutoff=LIKENESS)
    return f"; did you mean {prefix}{near[0]}?" if near else ""


class ViewerError(Exception):
    """A window cannot be opened here, or a file cannot be written; the message is one line and says why."""
