"""Spatial numbers that several families of messages share: metres, all of them finite."""

from typing import Annotated, Final

import msgspec

MAX_COORDINATE_M: Final = 1e9
MAX_DISTANCE_M: Final = 1e6

Coordinate = Annotated[float, msgspec.Meta(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
"""x, y, z in metres; NaN and infinity are refused."""

Distance = Annotated[float, msgspec.Meta(gt=0, le=MAX_DISTANCE_M)]
"""Metres. Never 0: that is no distance, but a missing one."""

Length = Annotated[float, msgspec.Meta(ge=0, le=MAX_DISTANCE_M)]
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
"""0 to 1."""
