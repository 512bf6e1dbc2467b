"""How a program joins the fleet: by its arguments, then by the variables that the commands read, then by defaults."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec
from pydantic import ValidationError

from bus import BusSettings
from fleetsight.errors import CertificateError, FleetsightError, SettingsError

PREFIX: Final = "FLEETSIGHT_"
LISTS: Final = ("connect", "listen")
FILES: Final = ("tls_ca", "tls_certificate", "tls_key")


def settings_of(arguments: Mapping[str, Any], environment: Mapping[str, str] | None = None) -> BusSettings:
    """Return the settings that the arguments, which are those of BusSettings, and the environment make.

    Raises:
        SettingsError: one cannot be; the message names it as it was given.
        CertificateError: a file of certificates is absent.
    """
    variables = os.environ if environment is None else environment
    names = {name: f"{PREFIX}{name.upper()}" for name in BusSettings.model_fields}
    given = {
        name: _list(variables[variable]) if name in LISTS else variables[variable]
        for name, variable in names.items()
        if variable in variables
    }
    try:
        return BusSettings.model_validate({**given, **arguments})
    except ValidationError as error:
        raise _refusal(error, {name: name if name in arguments else names[name] for name in names}) from error


def _list(text: str) -> list[str]:
    """Return the parts of a variable: separated by commas, or a JSON array, as the commands read it."""
    if text.lstrip().startswith("["):
        try:
            return msgspec.json.decode(text, type=list[str])
        except msgspec.MsgspecError:
            pass
    return [part.strip() for part in text.split(",")]


def _refusal(error: ValidationError, names: Mapping[str, str]) -> FleetsightError:
    mistake = error.errors(include_url=False)[0]
    reason = mistake["msg"].removeprefix("Value error, ")
    if not mistake["loc"]:  # settings that do not go together: the reason names them
        return SettingsError(reason)
    name, value = str(mistake["loc"][0]), mistake["input"]
    if name in FILES:
        return CertificateError(f"{names[name]} {Path(str(value))}: {reason}; name the file of it, in PEM")
    return SettingsError(f"{names[name]}{'' if repr(value) in reason else f' {value!r}'}: {reason}")
