"""The names of the guide's topics."""

from typing import Final

COLOR: Final = "/camera/color/image_raw"
DEPTH: Final = "/camera/depth/image_raw"
POINTS: Final = "/camera/depth/points"

DETECTION: Final = "/ultralytics/detection/image"
SEGMENTATION: Final = "/ultralytics/segmentation/image"
CLASSES: Final = "/ultralytics/detection/classes"
DISTANCE: Final = "/ultralytics/detection/distance"

OBJECTS_SHOWN: Final = "/ultralytics/segmentation/shown"
"""Not the guide's: how many objects' clouds its program would have shown. It publishes none."""
