"""Settings of the alerts."""

from pathlib import Path
from typing import ClassVar

from pydantic import BaseModel, Field


class AlertingSettings(BaseModel):
    """Which rules make alerts."""

    heading: ClassVar = "alerts"

    rules: Path | None = Field(default=None, description="YAML file of rules; read again whenever it changes")
