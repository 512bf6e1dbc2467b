"""Tracks the origin of settings, for error messages."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel
from yaml.nodes import Node

from services.toolbox.errors import UsageError
from services.yaml_text import YamlError, line_of, parse


@dataclass(slots=True)
class SettingsFile:
    """The file that `--config` names; empty until read. content, lines: by the settings' names.

    lines: where each setting is; in TOML nobody knows. named_by: what names the file.
    """

    named_by: str = "--config"
    path: Path | None = None
    content: Mapping[str, Any] = field(default_factory=dict)
    lines: Mapping[str, int] = field(default_factory=dict)

    def read(self, path: Path) -> None:
        """Read a file.

        Raises:
            UsageError: it cannot be read, is no mapping, has a setting twice, or names another file.
        """
        if path == Path():
            raise UsageError(f"{self.named_by} names no file")
        self.path = path
        content, root = self._parsed(path)
        names = [(key, str(key).replace("-", "_")) for key in content]
        self.lines = {name: line_of(root, [key]) for key, name in names} if root else {}
        self.content = {name: content[key] for key, name in names}
        every = [name for _, name in names]
        if twice := next((name for name in every if every.count(name) > 1), ""):
            raise UsageError(f"{self.place_of(twice)}: {twice!r} is given twice")
        if "config" in every:
            raise UsageError(f"{self.place_of('config')}: 'config' cannot be set in a file")

    def place_of(self, name: str) -> str:
        """Return the place of a setting in the file."""
        return f"{self.path}: line {self.lines[name]}" if name in self.lines else f"{self.path}"

    def value_of(self, name: str, kind: str) -> Any:
        """Return a setting's value; `kind` is its annotation, or empty for an unknown setting.

        A lone text is a list of one, where a list is meant: on the command line it is one too.

        Raises:
            UsageError: it is what YAML takes for true or false, which pydantic would take for 1 or 0.
        """
        value = self.content[name]
        if kind and "bool" not in kind and _says_yes_or_no(value):
            raise UsageError(
                f"{self.place_of(name)}: {name}: yes and no are not valid here; quote them to make them text"
            )
        return [value] if kind.startswith("list[") and isinstance(value, str) else value

    def _parsed(self, path: Path) -> tuple[Mapping[Any, Any], Node | None]:
        try:
            text = path.read_text(encoding="utf-8")
            content, root = (tomllib.loads(text), None) if path.suffix == ".toml" else parse(text)
        except OSError as error:
            raise UsageError(f"{self.named_by} {path}: {error.strerror}") from error
        except (ValueError, YamlError, RecursionError) as error:
            raise UsageError(f"{path}: {' '.join(str(error).split())}") from error
        if content is None:
            return {}, root
        if not isinstance(content, dict):
            raise UsageError(f"{path}: not a mapping; write settings as name: value pairs")
        return content, root


def _says_yes_or_no(value: Any) -> bool:
    if isinstance(value, dict | list):
        return any(map(_says_yes_or_no, value.values() if isinstance(value, dict) else value))
    return isinstance(value, bool)


ENV_PREFIX: Final = "FLEETSIGHT_"


@dataclass(frozen=True, slots=True)
class SettingOrigins:
    """The origins of settings."""

    argv: Sequence[str]
    environment: Mapping[str, str]
    file: SettingsFile
    model: type[BaseModel]

    def place_of(self, name: str) -> str:
        """Return the name for a setting in messages: as it was given, or as an option."""
        option, variable = option_of(name), f"{ENV_PREFIX}{name.upper()}"
        if self._is_typed(option):
            return option
        if variable in self.environment:
            return variable
        if name in self.file.content:
            return f"{self.file.place_of(name)}: {name}"
        return next(filter(self.environment.get, self._variables_of_ros(name)), option)

    def options(self) -> frozenset[str]:
        """Return the names of the model's fields that the command line gives, in whatever way they are spelt there."""
        fields = self.model.model_fields.items()
        return frozenset(name for name, field in fields if self._is_typed(option_of(field.alias or name)))

    def _is_typed(self, option: str) -> bool:
        typed = {argument.partition("=")[0] for argument in self.argv}
        return not typed.isdisjoint({option, option.replace("--", "--no-", 1)})

    def _variables_of_ros(self, name: str) -> list[str]:
        """Return the ROS variables that a setting defaults to, named in its description."""
        field = self.model.model_fields.get(name)
        return re.findall(r"\bROS_[A-Z]+(?:_[A-Z]+)*", field.description or "") if field else []

    def place_of_what_is_no_text(self) -> str:
        """Return the name of the first setting that is not UTF-8; its value may be secret."""
        for before, argument in pairwise(["", *self.argv]):
            if not _is_text(argument):
                return argument.partition("=")[0] if argument.startswith("--") else before
        variables = (f"{ENV_PREFIX}{name.upper()}" for name in self.model.model_fields)
        return next((name for name in variables if not _is_text(self.environment.get(name, ""))), "a setting")

    def options_in(self, reason: str) -> str:
        """Return a reason with settings' names replaced by those of options, unless they may be plain words."""
        names = {name for name in self.model.model_fields if "_" in name}
        return re.sub(r"\w+", lambda word: option_of(word[0]) if word[0] in names else word[0], reason)


def _is_text(value: str) -> bool:
    """Return whether a value is valid UTF-8; surrogates stand for invalid bytes."""
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


def option_of(name: str) -> str:
    return f"--{name.replace('_', '-')}"
