"""Load a process's settings: options first, then the environment, then a YAML or TOML file, then defaults."""

import re
import shutil
import sys
import tomllib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, Literal, NoReturn, TypeVar

import yaml
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

from services.toolbox.help import Usage, help_text, usage_line

ENV_PREFIX = "FLEETSIGHT_"
MAX_HELP_WIDTH = 100

S = TypeVar("S", bound=BaseModel)


LogLevel = Literal["debug", "info", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Loaded(Generic[S]):
    """A process's settings, and what every process has beside them. log_level: None unless it was told."""

    settings: S
    log_level: LogLevel | None


class UsageError(Exception):
    """A setting that is wrong; the message names it and fits on one line."""


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
    try:
        found = _settings_class(model, prog)(_cli_parse_args=list(argv))  # type: ignore[call-arg]
        own = {name: field for name, field in model.model_fields.items() if name in found.model_fields_set}
        settings = model.model_validate({field.alias or name: getattr(found, name) for name, field in own.items()})
    except ValidationError as error:
        raise UsageError(_first_mistake(error)) from error
    except SettingsError as error:
        raise UsageError(_unparsed(str(error), usage_line(model, usage))) from error
    return Loaded(settings, found.log_level)


class _Common(BaseSettings):
    heading: ClassVar = "any command"

    config: Annotated[Path | None, Field(description="YAML or TOML file with any of these settings")] = None
    log_level: Annotated[
        LogLevel | None,
        Field(description="least severe events written to stderr; info, or error for detect, clouds, users and call"),
    ] = None


def _settings_class(model: type[BaseModel], prog: str) -> type[_Common]:
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
            return (init_settings, _EnvironmentSource(settings_cls), _FileSource(settings_cls))

    Settings.__doc__ = model.__doc__
    return Settings


class _FileSource(InitSettingsSource):
    """The file that `--config` or FLEETSIGHT_CONFIG names; the sources before this one have found its path."""

    def __init__(self, settings_cls: type[BaseSettings]) -> None:
        super().__init__(settings_cls, init_kwargs={})

    def __call__(self) -> dict[str, Any]:
        path = self.current_state.get("config")
        return {} if path is None else dict(_read(Path(path)))


def _read(path: Path) -> Mapping[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
        content = tomllib.loads(text) if path.suffix == ".toml" else yaml.safe_load(text)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, yaml.YAMLError) as error:
        _wrong_file(path, str(error), error)
    if content is None:
        return {}
    if not isinstance(content, dict):
        _wrong_file(path, "settings are name: value pairs")
    return {str(name).replace("-", "_"): value for name, value in content.items()}


def _wrong_file(path: Path, reason: str, cause: Exception | None = None) -> NoReturn:
    raise UsageError(f"--config {path}: {' '.join(reason.split())}") from cause


def _unparsed(message: str, usage: str) -> str:
    """Say what could not be read from the command line; pydantic's own words on name=value pairs are Python's."""
    unreadable = re.match(r"Parsing error encountered for (\w+):", message)
    if unreadable is None:
        reason = message.removeprefix("error parsing CLI: ")
        misplaced = re.match(r"unrecognized arguments: [^-]", reason)
        return f"{reason} ({usage})" if misplaced else reason
    return f"--{unreadable[1].replace('_', '-')}: write it like name=value"


def _first_mistake(error: ValidationError) -> str:
    mistakes = sorted(error.errors(include_url=False), key=lambda mistake: mistake["type"] != "extra_forbidden")
    mistake = mistakes[0]  # a misspelt name first: it explains why another setting is missing
    reason = mistake["msg"].removeprefix("Value error, ")
    if not mistake["loc"]:  # settings that do not go together: the reason names them
        return reason
    place = [str(part) for part in mistake["loc"]]
    name = "--" + ".".join([place[0].replace("_", "-"), *place[1:]])
    match mistake["type"]:
        case "missing":
            return f"{name} is required (or {ENV_PREFIX}{place[0].upper()}, or in the file that --config names)"
        case "extra_forbidden":
            return f"{place[0]!r} is not a setting"
    return f"{name} {repr(mistake['input'])[:80]}: {reason}"
