"""Regions of cameras' images that objects are looked for in. Pure."""

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import Final

from schemas.detections import Box
from schemas.image import Area, ImageFrame, is_inside, parse_area
from schemas.keys import CameraKey
from services.detector.model import DetectedObjects

ANY_CAMERA: Final = "*/*"
REMEMBERED: Final = 1 << 12
"""Cameras whose regions are kept at hand."""


def parse_region(text: str) -> tuple[str, Area]:
    """Return the pattern of cameras, like `r1/front`, and the polygon for a region's text in the settings.

    Raises:
        ValueError: naming what can be written.
    """
    camera, sign, corners = text.rpartition("=")
    pattern = camera.strip() if sign else ANY_CAMERA
    if pattern.count("/") != 1 or not all(pattern.split("/")):
        raise ValueError(f"{pattern!r} is not a camera; use ROBOT/CAMERA, like r1/front or */rear")
    return pattern, parse_area(corners)


class Regions:
    """Leaves out objects outside of a camera's regions; a camera without any has no limits."""

    def __init__(self, given: Sequence[str]) -> None:
        self._rules = [parse_region(text) for text in given]
        self._areas = lru_cache(REMEMBERED)(self._areas_of)

    def within(self, camera: CameraKey, frame: ImageFrame, found: DetectedObjects) -> DetectedObjects:
        """Return the objects of a camera's frame whose boxes have their centre in a region."""
        areas = self._areas(camera) if self._rules else ()
        if not areas:
            return found
        kept = [each for each in found.objects if _is_in(areas, each.box, frame.width, frame.height)]
        return replace(found, objects=kept)

    def _areas_of(self, camera: CameraKey) -> tuple[Area, ...]:
        name = f"{camera.robot}/{camera.camera}"
        return tuple(area for pattern, area in self._rules if fnmatchcase(name, pattern))


def _is_in(areas: tuple[Area, ...], box: Box, width: int, height: int) -> bool:
    across, down = (box.x1 + box.x2) / 2 / width, (box.y1 + box.y2) / 2 / height
    return any(is_inside(area, across, down) for area in areas)
