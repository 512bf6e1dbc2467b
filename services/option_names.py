"""Settings that the command line gave, apart from those of an environment or a file that several commands share."""

from typing import Final

from pydantic import BaseModel, ValidationInfo
from pydantic_settings import BaseSettings

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
