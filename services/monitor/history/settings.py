"""Settings of the history, and of `fleetsight history`, which exports and maintains it."""

import os
import re
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, Self

from pydantic import (
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    Field,
    NaiveDatetime,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    field_validator,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from schemas.errors import SchemaError
from schemas.keys import check_name
from services.monitor.formats import epoch_ns
from services.option_names import Secret, given_as_options

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


def _has_password(url: str) -> bool:
    return re.search(r"//[^/@]*:[^/@]+@|[?&](?:ssl)?password=", url) is not None


HistoryUrl = Annotated[str, BeforeValidator(_url), Secret(_has_password)]


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


FIRST_YEAR: Final = 1970
LAST_YEAR: Final = 2261
"""The last full year that 64-bit nanoseconds since the epoch can hold in any time zone."""


def written_like(example: str) -> WrapValidator:
    """Return a validator that refuses invalid times with an example, and times the history cannot hold."""

    def read(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            at = handler(value)
        except ValidationError as error:
            raise ValueError(f"write a time like {example}") from error
        if not FIRST_YEAR <= at.year <= LAST_YEAR:
            raise ValueError(f"use a year from {FIRST_YEAR} to {LAST_YEAR}")
        return at

    return WrapValidator(read)


Moment = Annotated[AwareDatetime | NaiveDatetime, written_like("2026-11-20T06:00")]


class ExportSettings(BaseModel):
    """Write sightings (one row per interval of constant count) or alerts from a monitor's history to a file.

    Of the sites of world models it writes stock (one row per interval of a constant number of objects in a zone) or
    events (what became of objects).

    A name that ends in .parquet makes Parquet, which takes fleetsight's extra [parquet]. `backup` copies the whole
    database to a file while the monitor runs; `restore` makes a database of such a file where there is none.
    `trust-clock` says that the clock of the monitor's machine is right, where a monitor doubts it; `compact` makes an
    SQLite file as small as what is in it, and has it shrink by itself from then on.
    """

    task: Annotated[Literal["export", "backup", "restore", "trust-clock", "compact"], Field(description="what to do")]
    to: Annotated[Path | None, Field(description="file that export (.csv or .parquet) or backup writes")] = None
    source: Annotated[Path | None, Field(alias="from", description="backup that restore reads")] = None
    history: Annotated[HistoryUrl, Field(description="history database of the monitor")] = Field(
        default_factory=default_url
    )
    what: Annotated[Literal["sightings", "alerts", "stock", "events"], Field(description="what to export")] = (
        "sightings"
    )
    since: Annotated[Moment | None, Field(description="skip what ended before this time (2026-11-20T06:00)")] = None
    until: Annotated[Moment | None, Field(description="skip what began after this time")] = None
    robot: Annotated[str, Field(description="only this robot")] = ""
    camera: Annotated[str, Field(description="only cameras with this name")] = ""
    name: Annotated[str, Field(alias="class", description="only this class")] = ""
    site: Annotated[str, Field(description="only this site, of stock and events")] = ""
    zone: Annotated[str, Field(description="only this zone, of stock")] = ""

    bom: Annotated[bool, Field(description="begin CSV with a byte order mark, which Excel needs to read UTF-8")] = False

    @model_validator(mode="after")
    def _names_its_files(self, info: ValidationInfo) -> Self:
        needs = {"export": "to", "backup": "to", "restore": "source"}.get(self.task)
        if needs and getattr(self, needs) is None:
            option = {"to": "--to, the file to write", "source": "--from, the backup to read"}[needs]
            raise ValueError(f"{self.task} needs {option}")
        if self.task == "export":
            _check_kind(self.to)
        elif given := given_as_options(self, info) - {"task", "history", needs}:
            takes = {"to": "--to and --history", "source": "--from and --history"}.get(needs or "", "--history")
            raise ValueError(f"{self.task} takes only {takes}, not --{min(given)}")
        return self

    @model_validator(mode="after")
    def _narrows_what_it_has(self) -> Self:
        has = {"stock": {"site", "zone"}, "events": {"site"}}.get(self.what, {"robot", "camera"})
        wrong = sorted(name for name in {"robot", "camera", "site", "zone"} - has if getattr(self, name))
        if wrong:
            raise ValueError(
                f"{self.what} has no --{wrong[0]}; narrow it down by --{', --'.join(sorted(has))} or --class"
            )
        return self

    @field_validator("robot", "camera", "site")
    @classmethod
    def _is_a_name(cls, name: str, info: ValidationInfo) -> str:
        try:
            if name:
                check_name(str(info.field_name), name)
        except SchemaError as error:
            raise ValueError(str(error)) from error
        return name

    @model_validator(mode="after")
    def _begins_before_it_ends(self) -> Self:
        if self.since is not None and self.until is not None and epoch_ns(self.since) > epoch_ns(self.until):
            raise ValueError("--since is later than --until")
        return self

    @field_validator("history")
    @classmethod
    def _is_somewhere(cls, history: str) -> str:
        if history == NONE:
            raise ValueError("there is no history to export")
        return history


def _check_kind(to: Path | None) -> None:
    if to is None or to.suffix not in (".csv", ".parquet"):
        raise ValueError("the file name of --to must end in .csv or .parquet")
    if to.suffix == ".parquet" and find_spec("polars") is None:
        raise ValueError("Parquet needs polars, which is not installed: install fleetsight[parquet]")


LAST_NS: Final = epoch_ns(datetime(LAST_YEAR, 12, 31, tzinfo=UTC))
