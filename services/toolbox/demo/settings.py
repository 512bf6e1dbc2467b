"""Settings of the demo."""

from pathlib import Path
from typing import Annotated, Final, Self

from pydantic import BaseModel, Field, model_validator

SEED: Final = 0
"""Of the simulated warehouse."""


class DemoSettings(BaseModel):
    """Run simulated robots, their gateways, a detector and the monitor on this machine, each as its own process."""

    robots: Annotated[int, Field(ge=1, le=20, description="simulated robots, each with its own ROS master")] = 3
    hz: Annotated[float, Field(ge=0.001, le=60, description="images per second and robot")] = 2.0
    seconds: Annotated[float | None, Field(gt=0, description="stop after this many seconds")] = None
    model: Annotated[str | None, Field(description="weights or an ONNX file; by default the shipped model")] = None

    @model_validator(mode="after")
    def _model_is_here(self) -> Self:
        if self.model is not None and not Path(self.model).is_file():
            raise ValueError(f"--model {self.model}: no such file")
        return self
