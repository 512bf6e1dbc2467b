"""A subcommand: its purpose, settings and entry point, imported only when used."""

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import takewhile
from typing import Any

from pydantic import BaseModel

from services.toolbox.settings import LogLevel

Run = Callable[[BaseModel], Awaitable[int | None]]


@dataclass(frozen=True, slots=True)
class Command:
    """A subcommand. Names are "module:name".

    run: a coroutine function that takes the settings. refusals: the errors it raises for settings that turn out to be
    wrong once used. extra: what must be installed beyond the base. positional: settings that the first arguments are
    for where they are no options. arguments: a function that turns arguments of other kinds into options. log_level:
    least severe events written unless told otherwise. finite: it has an end of its own, instead of running until it is
    told to stop; or the setting that gives it one. lasting: the tasks of a finite one that have none. examples: whole
    command lines, for the help.
    """

    name: str
    summary: str
    settings: str
    run: str
    refusals: tuple[str, ...] = ("bus:BusError",)
    extra: str | None = None
    positional: tuple[str, ...] = ()
    arguments: str | None = None
    log_level: LogLevel = "info"
    finite: bool | str = False
    lasting: tuple[str, ...] = ()
    examples: tuple[str, ...] = ()

    def load_settings(self) -> type[BaseModel]:
        """Import the settings model."""
        found: type[BaseModel] = _load(self.settings)
        return found

    def options_of(self, arguments: Sequence[str]) -> Sequence[str]:
        """Return the options that the arguments stand for."""
        given = list(takewhile(lambda argument: not argument.startswith("-"), arguments[: len(self.positional)]))
        named = [option for name, value in zip(self.positional, given, strict=False) for option in (f"--{name}", value)]
        options = [*named, *arguments[len(given) :]]
        found: Sequence[str] = options if self.arguments is None else _load(self.arguments)(options)
        return found

    def ends(self, settings: BaseModel) -> bool:
        """Return whether the command ends by itself with these settings."""
        if self.lasting and getattr(settings, "task", None) in self.lasting:
            return False
        return self.finite if isinstance(self.finite, bool) else getattr(settings, self.finite) is not None

    def load_run(self) -> Run:
        """Import the coroutine function that runs the process."""
        found: Run = _load(self.run)
        return found

    def load_refusals(self) -> tuple[type[Exception], ...]:
        """Import the error types that reject settings."""
        return tuple(_load(refusal) for refusal in self.refusals)


def _load(reference: str) -> Any:
    module, name = reference.split(":")
    return getattr(import_module(module), name)
