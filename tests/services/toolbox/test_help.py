import shlex
from enum import StrEnum, auto
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import pytest
from pydantic import BaseModel, Field

from services.toolbox.command import Command
from services.toolbox.commands import COMMANDS
from services.toolbox.help import EXIT_CODES, Usage, help_text


class Common(BaseModel):
    heading: ClassVar = "any"

    level: Literal["low", "high"] = Field(default="low", description="how much")


class Kind(StrEnum):
    ONE = auto()
    OTHER = auto()


class Base(BaseModel):
    heading: ClassVar = "further"

    inherited: list[str] = Field(default=["a", "b"], description="some")
    changed: int = Field(default=1, description="again")


class Settings(Base):
    """What it is for.

    And more.
    """

    robot: str = Field(description="whose")
    rate: Annotated[float | None, Field(description="how fast")] = None
    pairs: dict[str, str] = Field(default={"a": "b"}, description="which")
    on: bool = Field(default=True, description="whether")
    changed: int = Field(default=2, description="again")
    file: Path = Field(default_factory=lambda: Path("made"), description="where")
    kinds: list[Kind] = Field(default=list(Kind), description="what")


class Arguments(BaseModel):
    """Takes something."""

    level: Literal["low", "high"]
    file: Path
    robot: str = ""


def test_every_setting_its_own_first_under_its_heading_with_its_default() -> None:
    shown = help_text(Settings, Common, Usage("test"), env_prefix="X_", width=80)
    assert shown.splitlines()[:22] == [
        "usage: test [OPTION ...]",
        "",
        "What it is for.",
        "",
        "And more.",
        "",
        "options:",
        "  -h, --help              show this and exit",
        "  --robot TEXT            whose (required)",
        "  --rate NUMBER           how fast",
        "  --pairs NAME=VALUE,...  which (default: a=b)",
        "  --on, --no-on           whether (default: yes)",
        "  --file FILE             where (default: made)",
        "  --kinds one|other,...   what (default: one,other)",
        "",
        "further:",
        "  --changed N             again (default: 2)",
        "  --inherited TEXT,...    some (default: a,b)",
        "",
        "any:",
        "  --level low|high        how much (default: low)",
        "",
    ]
    assert "X_LOG_LEVEL" in shown


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_no_commands_help_speaks_python(command: Command) -> None:
    shown = help_text(command.load_settings(), Common, Usage("test"), env_prefix="X_", width=100)
    for word in ("factory", "dict", "list[", "None", "<", "PosixPath", "Annotated"):
        assert word not in shown
    assert all(len(line) <= 100 for line in shown.splitlines() if "weights" not in line)


def test_usage_names_first_arguments_and_shows_examples() -> None:
    usage = Usage("test", ("level", "file", "robot"), ("test low picture r1", "test high"))
    lines = help_text(Arguments, Common, usage, env_prefix="X_", width=80).splitlines()
    assert lines[:7] == [
        "usage: test low|high FILE [ROBOT] [OPTION ...]",
        "",
        "Takes something.",
        "",
        "examples:",
        "  test low picture r1",
        "  test high",
    ]
    assert EXIT_CODES in " ".join(lines)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_examples_are_of_their_command_and_of_options_that_it_has(command: Command) -> None:
    assert command.examples
    fields = command.load_settings().model_fields
    known = {(field.alias or name).replace("_", "-") for name, field in fields.items()} | {"config"}
    for example in command.examples:
        program, name, *arguments = shlex.split(example)
        assert (program, name) == ("fleetsight", command.name)
        assert {option[2:] for option in command.options_of(arguments) if option.startswith("--")} <= known
