"""Settings of the history."""

import os
from pathlib import Path
from typing import Annotated, ClassVar, Final

from pydantic import AfterValidator, BaseModel, Field

NONE: Final = "none"
SCHEMES: Final = ("sqlite:///", "postgresql://")


def _url(value: str) -> str:
    if value != NONE and not value.startswith(SCHEMES):
        raise ValueError(
            f"write it like sqlite:////var/lib/fleetsight/history.db or postgresql://user@host/db, or {NONE}"
        )
    return value


HistoryUrl = Annotated[str, AfterValidator(_url)]


def default_state() -> Path:
    """Return the user's folder for what outlasts a process."""
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local/state") / "fleetsight"


def default_url() -> str:
    """Return where history is kept unless told otherwise."""
    return f"sqlite:///{default_state() / 'history.db'}"


class HistorySettings(BaseModel):
    """Where and how long history is kept."""

    heading: ClassVar = "history"

    history: HistoryUrl = Field(
        default_factory=default_url,
        description="database that keeps what was seen: sqlite:///FILE, postgresql://user@host/db, or none",
    )
    history_days: float = Field(default=30, gt=0, le=36_500, description="days after which history is forgotten")
