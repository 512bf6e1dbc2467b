"""Loads a process's settings from options, environment, a YAML or TOML file, and defaults, in that order."""

import os
import re
import shutil
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path, PurePath
from typing import Annotated, Any, ClassVar, Generic, Literal, TypeVar

from pydantic import BaseModel, Field, ValidationError
from pydantic.fields import FieldInfo
from pydantic_settings import (
    BaseSettings,
    EnvSettingsSource,
    InitSettingsSource,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    SettingsError,
)

from services.option_names import OPTIONS, holds_secret
from services.toolbox.errors import UsageError, meant
from services.toolbox.help import Usage, help_text, usage_line
from services.toolbox.setting_sources import ENV_PREFIX, SettingOrigins, SettingsFile, option_of

MAX_HELP_WIDTH = 100
MAX_VALUE = 80
"""Number of characters shown of a wrong value."""

S = TypeVar("S", bound=BaseModel)


LogLevel = Literal["debug", "info", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Loaded(Generic[S]):
    """A process's settings, and those of every process.

    log_level: None unless given. exposed: settings with secrets that the command line gave.
    """

    settings: S
    log_level: LogLevel | None
    exposed: tuple[str, ...] = ()


class _EnvironmentSource(EnvSettingsSource):
    """Variables in which lists are comma-separated and mappings are name=value pairs, as on the command line.

    JSON arrays and objects are read too; a lone `7` may be the name of a robot, and is text.
    """

    def decode_complex_value(self, field_name: str, field: FieldInfo, value: Any) -> Any:
        if value.lstrip().startswith(("[", "{")):
            with suppress(ValueError):
                return super().decode_complex_value(field_name, field, value)
        parts = [part.strip() for part in value.split(",")]
        return _pairs(field_name, parts) if "dict" in str(field.annotation) else parts


def _pairs(name: str, parts: Sequence[str]) -> dict[str, str]:
    pairs = [part.partition("=") for part in parts]
    mapping = {key.strip(): value.strip() for key, _, value in pairs}
    if any(not sign for _, sign, _ in pairs) or len(mapping) < len(pairs):
        raise UsageError(f"{ENV_PREFIX}{name.upper()} {','.join(parts)[:80]!r}: write it like name=value,other=value")
    return mapping


def load(
    model: type[S], argv: Sequence[str], *, prog: str, positional: Sequence[str] = (), examples: Sequence[str] = ()
) -> Loaded[S]:
    """Build `model` from the options in `argv`, `FLEETSIGHT_*` variables and the file that `--config` names.

    prog, positional, examples: what its help says of how it is called, see `Usage`.

    Raises:
        UsageError: an option, variable or key of the file is unknown, missing or wrong.
        SystemExit: `--help` was asked for and printed.
    """
    usage = Usage(prog, positional, examples)
    if not {"-h", "--help"}.isdisjoint(argv):
        width = min(shutil.get_terminal_size().columns, MAX_HELP_WIDTH)
        sys.stdout.write(help_text(model, _Common, usage, env_prefix=ENV_PREFIX, width=width))
        raise SystemExit(0)
    file = SettingsFile()
    given = SettingOrigins(argv, os.environ, file, model)
    _check_pairs(model, argv)
    file.named_by = given.place_of("config")
    try:
        found = _settings_class(model, prog, file)(_cli_parse_args=list(argv))  # type: ignore[call-arg]
        own = {name: field for name, field in model.model_fields.items() if name in found.model_fields_set}
        values = {field.alias or name: getattr(found, name) for name, field in own.items()}
        options = given.options()
        settings = model.model_validate(values, context={OPTIONS: options})
    except ValidationError as error:
        raise UsageError(_first_mistake(error, given)) from error
    except UnicodeEncodeError as error:
        raise UsageError(f"{given.place_of_what_is_no_text()}: not UTF-8") from error
    except SettingsError as error:
        raise UsageError(_unparsed(str(error), model, usage_line(model, usage))) from error
    secret = (name for name in sorted(options) if holds_secret(model.model_fields[name], getattr(settings, name)))
    return Loaded(settings, found.log_level, tuple(secret))


def names_of(model: type[BaseModel]) -> list[str]:
    """Return the names of a process's settings, and of those of every process."""
    return [field.alias or name for each in (model, _Common) for name, field in each.model_fields.items()]


def variables() -> set[str]:
    """Return our environment variables, without their common prefix."""
    return {each.removeprefix(ENV_PREFIX) for each in os.environ if each.startswith(ENV_PREFIX)}


def _check_pairs(model: type[BaseModel], argv: Sequence[str]) -> None:
    """Raise UsageError if an option gives a name twice: pydantic would silently take the last one."""
    for setting, field in model.model_fields.items():
        if not str(field.annotation).startswith("dict["):
            continue
        option = option_of(setting)
        texts = [text for each, text in pairwise(argv) if each == option]
        texts += [each.removeprefix(f"{option}=") for each in argv if each.startswith(f"{option}=")]
        names = [pair.partition("=")[0].strip() for text in texts for pair in text.split(",")]
        if twice := next((name for name in names if names.count(name) > 1), ""):
            raise UsageError(f"{option}: {twice} is given twice")


class _Common(BaseSettings):
    heading: ClassVar = "any command"

    config: Annotated[Path | None, Field(description="YAML or TOML file with any of these settings")] = None
    log_level: Annotated[
        LogLevel | None,
        Field(description="minimum severity on stderr; by default info, or error for detect, clouds, users and call"),
    ] = None


def _settings_class(model: type[BaseModel], prog: str, file: SettingsFile) -> type[_Common]:
    class Settings(_Common, model):  # type: ignore[misc, valid-type]
        model_config = SettingsConfigDict(
            env_prefix=ENV_PREFIX,
            env_prefix_target="all",
            cli_prog_name=prog,
            cli_kebab_case=True,
            cli_implicit_flags=True,
            cli_hide_none_type=True,
            cli_avoid_json=True,
            cli_exit_on_error=False,
            extra="forbid",
            allow_inf_nan=False,
        )

        @classmethod
        def settings_customise_sources(
            cls,
            settings_cls: type[BaseSettings],
            init_settings: PydanticBaseSettingsSource,
            env_settings: PydanticBaseSettingsSource,  # noqa: ARG003
            dotenv_settings: PydanticBaseSettingsSource,  # noqa: ARG003
            file_secret_settings: PydanticBaseSettingsSource,  # noqa: ARG003
        ) -> tuple[PydanticBaseSettingsSource, ...]:
            return (init_settings, _EnvironmentSource(settings_cls), _FileSource(settings_cls, file))

    Settings.__doc__ = model.__doc__
    return Settings


class _FileSource(InitSettingsSource):
    """The file that `--config` or FLEETSIGHT_CONFIG names; the sources before this one have found its path."""

    def __init__(self, settings_cls: type[BaseSettings], file: SettingsFile) -> None:
        super().__init__(settings_cls, init_kwargs={})
        self._file = file

    def __call__(self) -> dict[str, Any]:
        path = self.current_state.get("config")
        if path is None:
            return {}
        self._file.read(Path(path))
        return {name: self._file.value_of(name, self._kind_of(name)) for name in self._file.content}

    def _kind_of(self, name: str) -> str:
        field = self.settings_cls.model_fields.get(name)
        return "" if field is None else str(field.annotation)


def _unparsed(message: str, model: type[BaseModel], usage: str) -> str:
    """Return which argument could not be parsed; pydantic's own text on name=value pairs is Python's."""
    unreadable = re.match(r"Parsing error encountered for (\w+):", message)
    if unreadable is None:
        reason = message.removeprefix("error parsing CLI: ")
        if re.match(r"unrecognized arguments: [^-]", reason):
            return f"{reason} ({usage})"
        unknown = re.match(r"unrecognized arguments: (--[\w-]+)", reason)
        names = [name.replace("_", "-") for name in names_of(model)]
        return reason + (meant(unknown[1], names, "--") if unknown else "")
    return f"--{unreadable[1].replace('_', '-')}: write it like name=value"


def _first_mistake(error: ValidationError, given: SettingOrigins) -> str:
    mistakes = sorted(error.errors(include_url=False), key=lambda mistake: mistake["type"] != "extra_forbidden")
    mistake = mistakes[0]  # a misspelt name first: it explains why another setting is missing
    reason = mistake["msg"].removeprefix("Value error, ")
    if not mistake["loc"]:  # settings that do not go together: the reason names them
        return given.options_in(reason)
    name, read = str(mistake["loc"][0]), mistake["input"]
    value = repr(str(read) if isinstance(read, PurePath) else read)[:MAX_VALUE]
    if holds_secret(given.model.model_fields.get(name), read):
        return f"{given.place_of(name)}: {reason}"
    match mistake["type"]:
        case "missing":
            return f"{option_of(name)} is required (or {ENV_PREFIX}{name.upper()}, or in the file that --config names)"
        case "extra_forbidden":
            return f"{given.file.place_of(name)}: {name!r} is not a setting{meant(name, names_of(given.model))}"
    return f"{given.place_of(name)}{'' if value in reason else f' {value}'}: {reason}"
