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
    """Cut detected objects out of point clouds, for cameras whose object clouds are subscribed to."""

    points: Annotated[
        dict[str, str],
        AfterValidator(_points),
        Field(
            description="source of a camera's points, as camera=lidar, several separated by commas; by default the"
            " camera itself, or if it has no points the robot's first sensor that is not a camera"
        ),
    ] = {}
    target_frame: Annotated[
        str,
        Field(max_length=MAX_LABEL, description="frame of reference (z up) in which objects are placed; may be empty"),
    ] = "base_link"
    tolerance_ms: Annotated[
        float | None,
        Field(
            ge=0,
            le=1000,
            description="maximum difference between the stamps of an image and its points; by default half the period"
            " of the points",
        ),
    ] = None
    min_points: Annotated[int, Field(ge=1, le=10_000, description="minimum number of points per object")] = 10
    max_points: Annotated[int, Field(ge=100, le=1_000_000, description="maximum number of points sent per object")] = (
        100_000
    )
    voxel_m: Annotated[
        float, Field(ge=0, le=1, description="edge of the voxels, one point of each is sent; 0 sends all")
    ] = 0.0
    memory_mib: Annotated[
        int,
        Field(
            ge=16,
            le=1_048_576,
            description="memory for points and transforms that wait for detections, for all cameras together",
        ),
    ] = MEMORY_BYTES // MIB

    @property
    def limits(self) -> CloudLimits:
        """Limits on an object's points."""
        return CloudLimits(min_points=self.min_points, max_points=self.max_points, voxel_m=self.voxel_m)

    @property
    def tolerance_ns(self) -> int | None:
        """Maximum difference between stamps of one instant; None for half a period."""
        return None if self.tolerance_ms is None else round(self.tolerance_ms * 1e6)
