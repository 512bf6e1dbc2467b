"""Settings that the command line gave, as opposed to an environment or a file, and secrets, which need not be there."""

from __future__ import annotations

import getpass
import sys
import termios
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from pydantic_settings import BaseSettings

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationInfo
    from pydantic.fields import FieldInfo

OPTIONS: Final = "options"
"""The key of a validation's context that holds the names of the settings that were given as options."""


def given_as_options(settings: BaseModel, info: ValidationInfo) -> set[str]:
    """Return the names of settings that somebody asked for in this very call, in a model validator of mode "after".

    Without a context that names options, these are all that are not at their defaults; none of a `BaseSettings`, which
    reads the environment and is validated once more, with a context, as the settings of its process.
    """
    if info.context is not None:
        return settings.model_fields_set.intersection(info.context[OPTIONS])
    return set() if isinstance(settings, BaseSettings) else settings.model_fields_set


@dataclass(frozen=True, slots=True)
class Secret:
    """Marks a setting, in its annotation, that may hold a secret: no message shows it.

    holds: whether a value is or contains one.
    """

    holds: Callable[[str], bool] = bool


def holds_secret(field: FieldInfo | None, value: object) -> bool:
    """Whether a value of a setting is, or contains, a secret."""
    marks = () if field is None else (each for each in field.metadata if isinstance(each, Secret))
    return any(mark.holds(str(value)) for mark in marks)


@contextmanager
def terminal_left_as_it_is() -> Iterator[None]:
    """Restore the terminal's echo, also if a signal ends the process and the asking thread is abandoned."""
    try:
        before = termios.tcgetattr(sys.stdin)
    except (termios.error, OSError):  # standard input is no terminal
        yield
        return
    try:
        yield
    finally:
        with suppress(termios.error):  # the terminal is gone
            termios.tcsetattr(sys.stdin, termios.TCSAFLUSH, before)  # drops a half-typed secret


def read_secret(prompt: str, most: int) -> str:
    """Return a secret: asked for on a terminal, else the first line of standard input, of `most` characters."""
    if sys.stdin.isatty():
        return getpass.getpass(prompt)
    return sys.stdin.readline(most).rstrip("\r\n")
