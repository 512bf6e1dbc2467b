"""fleetsight: what every robot of a warehouse fleet sees, known centrally."""

import importlib.metadata
import sys
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial

from pydantic import BaseModel

from fleetsight.own_packages import ALL
from schemas.printing import printable
from services.toolbox import logs, process
from services.toolbox.command import Command
from services.toolbox.commands import COMMANDS
from services.toolbox.errors import UsageError, meant
from services.toolbox.help import EXIT_CODES
from services.toolbox.setting_sources import ENV_PREFIX, option_of
from services.toolbox.settings import load, names_of, variables
from services.toolbox.stdio import PrintError

OURS = ("fleetsight", *ALL)
HELP_OPTIONS = ("-h", "--help", "help")
PROG = "fleetsight"
WIDTH = 100


def main(argv: Sequence[str]) -> int:
    """Run the subcommand that `argv` names and return the exit code: 0 done, 1 failed, 2 called wrongly."""
    try:
        return _run_named(list(argv))
    except BrokenPipeError:  # the reader of the output closed it early
        return 0
    except PrintError as error:
        return process.lost(error)


def _run_named(arguments: list[str]) -> int:
    name = arguments.pop(0) if arguments else ""
    if name in HELP_OPTIONS:
        sys.stdout.write(overview())
        return process.written(0)
    if name == "--version":
        sys.stdout.write(f"{PROG} {importlib.metadata.version(PROG)}\n")
        return process.written(0)
    command = next((command for command in COMMANDS if command.name == name), None)
    if command is None:
        near = meant(name, [command.name for command in COMMANDS])
        sys.stderr.write(f"{PROG}: {f'no command {name!r}{near}' if name else 'a command is missing'}\n\n{overview()}")
        return process.EXIT_USAGE
    return _start(command, arguments)


def overview() -> str:
    """Return the help text that lists the subcommands."""
    lines = [f"usage: {PROG} COMMAND [OPTION ...]", "", __doc__ or "", "", "commands:"]
    lines += [f"  {command.name:<10} {command.summary}" for command in COMMANDS]
    lines += ["", f"'{PROG} COMMAND --help' lists a command's options; each is also read from the environment", ""]
    lines[-1:] = [
        "(FLEETSIGHT_ROBOT for --robot) and from the YAML or TOML file that --config names.",
        "",
        *textwrap.wrap(EXIT_CODES, WIDTH),
        "",
    ]
    return "\n".join(lines)


def _start(command: Command, arguments: Sequence[str]) -> int:
    prog = f"{PROG} {command.name}"
    try:
        model = command.load_settings()
        for doubt in _doubts(model):
            sys.stderr.write(f"{prog}: {printable(doubt)}\n")
        loaded = load(
            model,
            command.options_of(arguments),
            prog=prog,
            positional=command.positional,
            examples=command.examples,
        )
        for name in loaded.exposed:
            sys.stderr.write(f"{prog}: {_exposure(name)}\n")
        lasting = not command.ends(loaded.settings)
        logs.configure(loaded.log_level or ("info" if lasting else command.log_level))
        return _run(command, loaded.settings)
    except ModuleNotFoundError as error:
        if command.extra is None or error.name is None or error.name.split(".")[0] in OURS:
            raise
        reason = f"{error.name} is not installed; it comes with pip install -c constraints.txt '.[{command.extra}]'"
    except UsageError as error:
        reason = str(error)
    except SystemExit:  # help was asked for, and printed
        return process.written(0)
    sys.stderr.write(f"{prog}: {printable(reason)}\n")
    return process.EXIT_USAGE


def _exposure(name: str) -> str:
    return (
        f"{option_of(name)} holds a secret, which everybody on this machine can see in the list of processes: give it"
        f" in {ENV_PREFIX}{name.upper()}, or in the file that --config names"
    )


def _doubts(model: type[BaseModel]) -> Iterator[str]:
    """Yield a line for each variable that resembles one of these settings but belongs to no command."""
    known = {name.upper() for name in names_of(model)}
    near = {name: hint for name in sorted(variables() - known) if (hint := meant(name, known, ENV_PREFIX))}
    every = _every_name() if near else set()
    for name, hint in near.items():
        if name.lower() not in every:
            yield f"{ENV_PREFIX}{name} in the environment is not a setting{hint}"


def _every_name() -> set[str]:
    found: set[str] = set()
    for command in COMMANDS:
        with suppress(ModuleNotFoundError):  # an extra that is not installed
            found.update(names_of(command.load_settings()))
    return found


def _run(command: Command, settings: BaseModel) -> int:
    """Run the process.

    Raises:
        UsageError: the process refuses its settings.
    """
    main_function = command.load_run()
    try:
        return process.run(partial(main_function, settings), finite=command.ends(settings))
    except Exception as error:
        if isinstance(error, command.load_refusals()):
            raise UsageError(" ".join(str(error).split())) from error
        raise
