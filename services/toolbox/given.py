"""Where settings came from: what a mistake is called by."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from pydantic import BaseModel

from services.toolbox.settings_file import SettingsFile

ENV_PREFIX: Final = "FLEETSIGHT_"


@dataclass(frozen=True, slots=True)
class Given:
    """Where settings came from."""

    argv: Sequence[str]
    environment: Mapping[str, str]
    file: SettingsFile
    model: type[BaseModel]

    def place_of(self, name: str) -> str:
        """Return what to call a setting: as it was given, or as an option."""
        option, variable = option_of(name), f"{ENV_PREFIX}{name.upper()}"
        typed = {argument.partition("=")[0] for argument in self.argv}
        if not typed.isdisjoint({option, option.replace("--", "--no-", 1)}):
            return option
        if variable in self.environment:
            return variable
        if name in self.file.content:
            return f"{self.file.place_of(name)}: {name}"
        return next(filter(self.environment.get, self._variables_of_ros(name)), option)

    def _variables_of_ros(self, name: str) -> list[str]:
        """Return the variables that a setting is from where it is given nowhere, as its description has them."""
        field = self.model.model_fields.get(name)
        return re.findall(r"\bROS_[A-Z]+(?:_[A-Z]+)*", field.description or "") if field else []

    def place_of_what_is_no_text(self) -> str:
        """Return what to call the first setting that is no UTF-8; its value may be secret."""
        for before, argument in pairwise(["", *self.argv]):
            if not _is_text(argument):
                return argument.partition("=")[0] if argument.startswith("--") else before
        variables = (f"{ENV_PREFIX}{name.upper()}" for name in self.model.model_fields)
        return next((name for name in variables if not _is_text(self.environment.get(name, ""))), "a setting")

    def options_in(self, reason: str) -> str:
        """Return a reason with settings' names as those of options, as far as they cannot be words."""
        names = {name for name in self.model.model_fields if "_" in name}
        return re.sub(r"\w+", lambda word: option_of(word[0]) if word[0] in names else word[0], reason)


def _is_text(value: str) -> bool:
    """Return whether a value can be encoded; what is no UTF-8 is kept in a way that cannot."""
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


def option_of(name: str) -> str:
    return f"--{name.replace('_', '-')}"
