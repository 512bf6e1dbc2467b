"""Settings of the history."""

import os
import re
from pathlib import Path
from typing import Annotated, ClassVar, Final

from pydantic import BaseModel, BeforeValidator, Field, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

NONE: Final = "none"
SCHEMES: Final = ("sqlite:///", "postgresql://")

NO_FILES: Final = ("sqlite:///", "sqlite:///:memory:")
"""SQLite's databases that are gone with the connection."""

_PORT: Final = re.compile(
    r"postgresql://(?:[^:/]*(?::[^@]*)?@)?(?:\[[^/?]+\]|[^/:?]+)?(?::(?P<port>[^/?]*))?(?:[/?].*)?"
)
"""Where SQLAlchemy finds the port of a URL, if it has one."""

_HIGHEST_PORT: Final = 65535


def _url(value: object) -> str:
    if value == NONE:
        return NONE
    text = str(value)
    garbled = text.startswith("postgresql://") and not text.isprintable()  # what is no UTF-8 is not, either
    if garbled or not text.startswith(SCHEMES):
        raise _refusal(
            text, f"write it like sqlite:////var/lib/fleetsight/history.db or postgresql://user@host/db, or {NONE}"
        )
    if text.partition("?")[0] in NO_FILES:
        raise _refusal(text, f"it names no file, and so keeps nothing; {NONE} says that")
    port = match["port"] if (match := _PORT.fullmatch(text)) else None
    if port and not (port.isdecimal() and int(port) <= _HIGHEST_PORT):
        raise _refusal(
            text, f"what follows its host is no port, a number up to {_HIGHEST_PORT}; write @ in a password as %40"
        )
    return text


def _refusal(text: str, reason: str) -> ValidationError:
    """Return an error that shows no more of a URL than its scheme: it may hold a password."""
    scheme = re.match(r"\w*(?=://)", text)
    shown = f"{scheme[0]}://..." if scheme else "..."
    error = InitErrorDetails(type=PydanticCustomError("history_url", reason), input=shown)
    return ValidationError.from_exception_data("history", [error])


HistoryUrl = Annotated[str, BeforeValidator(_url)]


def default_state() -> Path:
    """Return the user's folder for persistent state."""
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local/state") / "fleetsight"


def default_url() -> str:
    """Return the default URL of the history."""
    return f"sqlite:///{default_state() / 'history.db'}"


class HistorySettings(BaseModel):
    """Location and retention time of the history."""

    heading: ClassVar = "history"

    history: HistoryUrl = Field(
        default_factory=default_url,
        description="database that keeps what was seen: sqlite:///FILE, postgresql://user@host/db, or none",
    )
    history_days: float = Field(default=30, gt=0, le=36_500, description="days after which history is forgotten")
