"""Settings of `fleetsight rules test`."""

from typing import Annotated, Literal

from pydantic import BaseModel, Field

from services.monitor.export.settings import Moment
from services.monitor.history.settings import HistoryUrl, default_url
from services.monitor.settings import RegularFile


class RulesSettings(BaseModel):
    """Test a rule file on a monitor's history: print each alert that it would have raised.

    A mistake in the file is shown with its line.
    """

    task: Annotated[Literal["test"], Field(description="what to do")]
    file: Annotated[RegularFile, Field(description="the rule file")]
    history: Annotated[HistoryUrl, Field(description="history database of the monitor")] = Field(
        default_factory=default_url
    )
    since: Annotated[Moment | None, Field(description="skip what ended before this time (2026-11-20T06:00)")] = None
