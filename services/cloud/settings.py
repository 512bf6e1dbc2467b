"""Settings of the cloud service."""

from typing import Annotated

from pydantic import AfterValidator, Field

from bus.settings import BusSettings
from bus.sharing.settings import SharingSettings
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL
from schemas.keys import CameraKey
from services.cloud.measuring import CloudLimits
from services.geometry.memory_budget import MEMORY_BYTES, MIB


def _points(points: dict[str, str]) -> dict[str, str]:
    try:
        for name in (*points, *points.values()):
            CameraKey("robot", name)
    except SchemaError as error:
        raise ValueError(str(error)) from error
    return points


class CloudSettings(SharingSettings, BusSettings):
    """Cut the objects that detectors found out of point clouds, for cameras whose object clouds somebody wants."""

    points: Annotated[
        dict[str, str],
        AfterValidator(_points),
        Field(
            description="where a camera's points are from, as camera=lidar, several separated by commas; unless given,"
            " the camera itself, and for one without points the robot's first sensor that is no camera"
        ),
    ] = {}
    target_frame: Annotated[
        str,
        Field(
            max_length=MAX_LABEL, description="frame of reference that objects are placed in, its z up; may be empty"
        ),
    ] = "base_link"
    tolerance_ms: Annotated[
        float | None,
        Field(
            ge=0,
            le=1000,
            description="how far apart the stamps of a picture and its points may be; half the points' period"
            " unless given",
        ),
    ] = None
    min_points: Annotated[int, Field(ge=1, le=10_000, description="fewer points are no object")] = 10
    max_points: Annotated[int, Field(ge=100, le=1_000_000, description="most points of one object that are sent")] = (
        100_000
    )
    voxel_m: Annotated[
        float, Field(ge=0, le=1, description="edge of cubes of each of which one point is sent; 0 sends all")
    ] = 0.0
    memory_mib: Annotated[
        int,
        Field(
            ge=16,
            le=1_048_576,
            description="memory for points and transforms that wait for detections, of all cameras together",
        ),
    ] = MEMORY_BYTES // MIB

    @property
    def limits(self) -> CloudLimits:
        """What becomes of an object's points."""
        return CloudLimits(min_points=self.min_points, max_points=self.max_points, voxel_m=self.voxel_m)

    @property
    def tolerance_ns(self) -> int | None:
        """How far apart stamps of one instant may be; None for half a period."""
        return None if self.tolerance_ms is None else round(self.tolerance_ms * 1e6)
