"""Formats the help text of a command: purpose, usage, and every setting with its default. Pure."""

import inspect
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

INDENT: Final = 26
EXIT_CODES: Final = (
    "Exit code: 0 when the command is done, or was stopped where it runs until stopped; 1 when it failed; 2 for a"
    " usage error; 128 plus the signal's number when it was interrupted before it was done."
)
PLACEHOLDERS: Final = {str: "TEXT", int: "N", float: "NUMBER", Path: "FILE"}


@dataclass(frozen=True, slots=True)
class Usage:
    """The usage of a command. positional: settings given as the first arguments. examples: whole commands."""

    prog: str
    positional: Sequence[str] = ()
    examples: Sequence[str] = ()


def help_text(model: type[BaseModel], common: type[BaseModel], usage: Usage, *, env_prefix: str, width: int) -> str:
    """Describe a command by its settings model and the settings of every command, `common`.

    Settings of a base class with a `heading` are listed under it. Lines are at most `width` characters long where words
    allow it.
    """
    about = inspect.cleandoc(model.__doc__ or "")
    return "\n".join(
        [
            usage_line(model, usage),
            "",
            *_paragraphs(about, width),
            *_examples(usage),
            "options:",
            *_option("-h, --help", "show this and exit", width),
            *(line for each in (model, common) for line in _groups(each, width)),
            "",
            *_paragraphs(
                f"Each is also read from the environment ({env_prefix}LOG_LEVEL for --log-level) and from the file that"
                " --config names; options override the environment, and the environment overrides the file.",
                width,
            ),
            *_paragraphs(EXIT_CODES, width),
        ]
    )


def usage_line(model: type[BaseModel], usage: Usage) -> str:
    """Return the usage line of a command."""
    arguments = (_argument(name, model.model_fields[name]) for name in usage.positional)
    return f"usage: {' '.join([usage.prog, *arguments])} [OPTION ...]"


def _argument(name: str, field: FieldInfo) -> str:
    choices = _placeholder(field.annotation)
    word = choices if "|" in choices else name.upper()
    return word if field.is_required() else f"[{word}]"


def _examples(usage: Usage) -> list[str]:
    return ["examples:", *(f"  {example}" for example in usage.examples), ""] if usage.examples else []


def _paragraphs(text: str, width: int) -> Iterator[str]:
    for paragraph in text.split("\n\n"):
        yield from textwrap.wrap(" ".join(paragraph.split()), width)
        yield ""


def _groups(model: type[BaseModel], width: int) -> Iterator[str]:
    for heading, names in _names_by_heading(model).items():
        if heading:
            yield from ("", f"{heading}:")
        for name in names:
            yield from _setting(name, model, width)


def _names_by_heading(model: type[BaseModel]) -> dict[str, list[str]]:
    """Return the names of settings by the heading of their class, the model's own before inherited ones."""
    introduced = {
        name: vars(each).get("heading", "") for each in model.__mro__ for name in inspect.get_annotations(each)
    }
    found: dict[str, list[str]] = {"": []}
    for name, heading in introduced.items():
        if name in model.model_fields:
            found.setdefault(heading, []).append(name)
    return found


def _setting(name: str, model: type[BaseModel], width: int) -> list[str]:
    field = model.model_fields[name]
    option = "--" + (field.alias or name).replace("_", "-")
    if field.annotation in (bool, bool | None):
        option += f", --no-{option[2:]}"
    else:
        option += f" {_placeholder(field.annotation)}"
    return _option(option, f"{field.description or ''} {_default(field)}".strip(), width)


def _option(option: str, about: str, width: int) -> list[str]:
    lines = textwrap.wrap(about, max(20, width - INDENT), break_on_hyphens=False, break_long_words=False)
    head = f"  {option}"
    if len(head) + 2 <= INDENT and lines:
        head, lines = head.ljust(INDENT) + lines[0], lines[1:]
    return [head, *(" " * INDENT + line for line in lines)]


def _placeholder(kind: Any) -> str:
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _placeholder(inner[0])
    if origin in (Union, UnionType):
        return _placeholder(next(each for each in inner if each is not NoneType))
    if origin is Literal or (isinstance(kind, type) and issubclass(kind, StrEnum)):
        return "|".join(str(choice) for choice in inner or kind)
    if origin is list:
        return f"{_placeholder(inner[0])},..."
    if origin is dict:
        return "NAME=VALUE,..."
    return PLACEHOLDERS.get(kind, "VALUE")


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "(required)"
    value = field.get_default(call_default_factory=True, validated_data={})
    if value is None or value in ("", [], {}):
        return ""
    match value:
        case bool():
            return f"(default: {'yes' if value else 'no'})"
        case list():
            return f"(default: {','.join(map(str, value))})"
        case dict():
            return f"(default: {','.join(f'{key}={item}' for key, item in value.items())})"
    return f"(default: {value})"
