"""Why one camera's detections or points were of no use. Pure."""

from typing import Final

REPLACED: Final = "replaced by newer detections"
DOUBLE: Final = "the same detections again, or older ones"
MALFORMED: Final = "malformed detections"
MALFORMED_POINTS: Final = "malformed points"
MALFORMED_INFO: Final = "malformed camera info"
MALFORMED_TRANSFORMS: Final = "malformed transforms"
TOO_MANY_POINTS: Final = "points: too many at once"
TOO_MANY_TRANSFORMS: Final = "transforms: too many at once"
UNSTAMPED: Final = "points without a stamp"
UNJOINED: Final = "no points of the same instant"
UNPLACED: Final = "points that cannot be brought to the picture"
FAILED: Final = "failed"
