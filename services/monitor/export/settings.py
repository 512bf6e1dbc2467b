"""Settings of the export."""

from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import (
    AwareDatetime,
    BaseModel,
    Field,
    NaiveDatetime,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    field_validator,
    model_validator,
)

from schemas.errors import SchemaError
from schemas.keys import check_name
from services.monitor.formats import epoch_ns
from services.monitor.history.settings import NONE, HistoryUrl, default_url
from services.option_names import given_as_options

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

    A name that ends in .parquet makes Parquet, which takes fleetsight's extra [parquet]. `trust-clock` says that the
    clock of the monitor's machine is right, where a monitor doubts it; `compact` makes an SQLite file as small as what
    is in it, and has it shrink by itself from then on.
    """

    task: Annotated[Literal["export", "trust-clock", "compact"], Field(description="what to do")]
    to: Annotated[Path | None, Field(description="file to write, .csv or .parquet; required for export")] = None
    history: Annotated[HistoryUrl, Field(description="history database of the monitor")] = Field(
        default_factory=default_url
    )
    what: Annotated[Literal["sightings", "alerts"], Field(description="what to export")] = "sightings"
    since: Annotated[Moment | None, Field(description="skip what ended before this time (2026-11-20T06:00)")] = None
    until: Annotated[Moment | None, Field(description="skip what began after this time")] = None
    robot: Annotated[str, Field(description="only this robot")] = ""
    camera: Annotated[str, Field(description="only cameras with this name")] = ""
    name: Annotated[str, Field(alias="class", description="only this class")] = ""

    bom: Annotated[bool, Field(description="begin CSV with a byte order mark, which Excel needs to read UTF-8")] = False

    @field_validator("to")
    @classmethod
    def _is_of_a_kind(cls, to: Path | None) -> Path | None:
        if to is None:
            return to
        if to.suffix not in (".csv", ".parquet"):
            raise ValueError("the file name must end in .csv or .parquet")
        if to.suffix == ".parquet" and find_spec("polars") is None:
            raise ValueError("Parquet needs polars, which is not installed: install fleetsight[parquet]")
        return to

    @model_validator(mode="after")
    def _writes_a_file_if_it_exports(self, info: ValidationInfo) -> Self:
        if self.task == "export" and self.to is None:
            raise ValueError("export needs --to, the file to write")
        if self.task != "export" and (given := given_as_options(self, info) - {"task", "history"}):
            raise ValueError(f"{self.task} takes only --history, not --{min(given)}")
        return self

    @field_validator("robot", "camera")
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


LAST_NS: Final = epoch_ns(datetime(LAST_YEAR, 12, 31, tzinfo=UTC))
