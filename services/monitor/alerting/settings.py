"""Settings of the alerts."""

from typing import ClassVar

from pydantic import BaseModel, Field

from services.monitor.regular_file import RegularFile


class AlertingSettings(BaseModel):
    """Which rules make alerts."""

    heading: ClassVar = "alerts"

    rules: RegularFile | None = Field(default=None, description="YAML file of rules; read again whenever it changes")
