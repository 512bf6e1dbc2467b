"""Settings of a distance worker."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from bus.settings import BusSettings
from bus.sharing.settings import SharingSettings
from schemas.distances import MAX_PLACES
from schemas.header import MAX_LABEL
from services.distance.depth_in_color_view import DepthLimits
from services.distance.depth_readings import Criteria
from services.geometry.memory_budget import MEMORY_BYTES, MIB


class DistanceSettings(SharingSettings, BusSettings):
    """Measure the distance and position of detected objects, while they are subscribed to."""

    frames: Annotated[
        list[Annotated[str, Field(min_length=1, max_length=MAX_LABEL)]],
        Field(
            max_length=MAX_PLACES - 1,
            description="frames of reference in which objects are placed, besides the camera's optical frame",
        ),
    ] = ["base_link", "map"]
    view_frame: Annotated[
        str,
        Field(
            min_length=1,
            max_length=MAX_LABEL,
            description="which of them is the map of a site, in which the world model knows objects",
        ),
    ] = "map"
    view_hz: Annotated[
        float, Field(gt=0, le=100, description="views a second, at most, that a camera sends to the world model")
    ] = 3.0
    min_pixels: Annotated[int, Field(ge=1, le=100_000, description="minimum number of depth readings per object")] = 30
    edge_pixels: Annotated[int, Field(ge=0, le=20, description="pixels trimmed from the edges of masks")] = 0
    nearest_m: Annotated[float, Field(ge=0, description="nearer depth is ignored")] = 0.1
    farthest_m: Annotated[float, Field(gt=0, le=10_000, description="farther depth is ignored")] = 20.0
    tolerance_ms: Annotated[
        float | None,
        Field(
            ge=0,
            le=1_000,
            description="maximum difference between the stamps of colour and depth; by default half the period of the"
            " depth images",
        ),
    ] = None
    memory_mib: Annotated[
        int,
        Field(
            ge=16,
            le=1_048_576,
            description="memory for depth and transforms that wait for detections, for all cameras together",
        ),
    ] = MEMORY_BYTES // MIB

    @model_validator(mode="after")
    def _something_can_be_measured(self) -> Self:
        if self.farthest_m <= self.nearest_m:
            raise ValueError(f"farthest_m: {self.farthest_m:g} must be greater than nearest_m, {self.nearest_m:g}")
        return self

    @property
    def criteria(self) -> Criteria:
        """The criteria for readings."""
        return Criteria(min_pixels=self.min_pixels, edge=self.edge_pixels)

    @property
    def limits(self) -> DepthLimits:
        """The range of valid depth."""
        return DepthLimits(nearest_m=self.nearest_m, farthest_m=self.farthest_m)

    @property
    def tolerance_ns(self) -> int | None:
        """Maximum difference between stamps of one instant; None for half a period."""
        return None if self.tolerance_ms is None else round(self.tolerance_ms * 1e6)
