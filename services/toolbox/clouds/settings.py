"""Settings of `fleetsight clouds`."""

import os
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from bus.settings import BusSettings
from schemas.errors import SchemaError
from schemas.keys import CameraKey


class CloudsSettings(BusSettings):
    """Show the clouds of a camera's objects, or save them.

    Asking for them makes a cloud worker and a detector work. View shows them in a window, as they come, until it is
    closed. Save writes each message that has points to files that Open3D, CloudCompare, MeshLab and PCL read, and ends.
    """

    do: Annotated[Literal["view", "save"], Field(description="what to do; also the first argument")]
    robot: Annotated[str, Field(description="name of the robot; also the second argument")]
    camera: Annotated[str, Field(description="name of the camera; also the third argument")]
    folder: Annotated[Path, Field(description="folder to save to; created if missing")] = Path()
    formats: Annotated[
        list[Literal["ply", "pcd"]], Field(min_length=1, description="file formats: ply, pcd or both")
    ] = ["ply", "pcd"]
    count: Annotated[int, Field(ge=1, le=10_000, description="number of messages to save")] = 1
    timeout_s: Annotated[float, Field(gt=0, le=3600, description="seconds to wait for each message to save")] = 10.0

    @field_validator("folder")
    @classmethod
    def _is_no_file(cls, folder: Path) -> Path:
        if os.path.exists(folder) and not os.path.isdir(folder):  # noqa: PTH110, PTH112 - these raise nothing
            raise ValueError("no folder")
        return folder

    @model_validator(mode="after")
    def _names_a_camera(self) -> Self:
        try:
            CameraKey(self.robot, self.camera)
        except SchemaError as error:
            raise ValueError(str(error)) from error
        return self

    @property
    def key(self) -> CameraKey:
        """The camera."""
        return CameraKey(self.robot, self.camera)
