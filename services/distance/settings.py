"""Settings of a distance worker."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from bus.settings import BusSettings
from bus.sharing.settings import SharingSettings
from schemas.distances import MAX_PLACES
from schemas.header import MAX_LABEL
from services.distance.depth_readings import Criteria
from services.distance.views import DepthLimits
from services.geometry.memory_budget import MEMORY_BYTES, MIB


class DistanceSettings(SharingSettings, BusSettings):
    """Measure how far away the objects are that a detector found, and where, for as long as somebody wants to know."""

    frames: Annotated[
        list[Annotated[str, Field(min_length=1, max_length=MAX_LABEL)]],
        Field(
            max_length=MAX_PLACES - 1,
            description="frames of reference to place objects in, beside the camera's own optical frame",
        ),
    ] = ["base_link", "map"]
    min_pixels: Annotated[
        int, Field(ge=1, le=100_000, description="readings that an object needs for its distance to be known")
    ] = 30
    edge_pixels: Annotated[int, Field(ge=0, le=20, description="pixels taken off at the edges of masks")] = 0
    nearest_m: Annotated[float, Field(ge=0, description="what is nearer is no reading")] = 0.1
    farthest_m: Annotated[float, Field(gt=0, le=10_000, description="what is farther is no reading")] = 20.0
    tolerance_ms: Annotated[
        float | None,
        Field(
            ge=0,
            le=1_000,
            description="how far apart the stamps of colour and depth may be; unless given, half of what lies between"
            " two depth images",
        ),
    ] = None
    memory_mib: Annotated[
        int,
        Field(
            ge=16,
            le=1_048_576,
            description="memory for depth and transforms that wait for detections, of all cameras together",
        ),
    ] = MEMORY_BYTES // MIB

    @model_validator(mode="after")
    def _something_can_be_measured(self) -> Self:
        if self.farthest_m <= self.nearest_m:
            raise ValueError(f"farthest_m: {self.farthest_m:g} is not beyond nearest_m, {self.nearest_m:g}")
        return self

    @property
    def criteria(self) -> Criteria:
        """When readings count."""
        return Criteria(min_pixels=self.min_pixels, edge=self.edge_pixels)

    @property
    def limits(self) -> DepthLimits:
        """What is a reading."""
        return DepthLimits(nearest_m=self.nearest_m, farthest_m=self.farthest_m)

    @property
    def tolerance_ns(self) -> int | None:
        """How far apart stamps of one instant may be; None for half a period."""
        return None if self.tolerance_ms is None else round(self.tolerance_ms * 1e6)
