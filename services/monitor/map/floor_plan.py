"""Images of the floor in the map, below everything else: its plan, which is read, and when it was looked at.

Source: http://wiki.ros.org/map_server#YAML_format
"""

import hashlib
import io
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from pydantic import BaseModel, Field, FiniteFloat, ValidationError, model_validator

from schemas.world import LONG_AGO, FloorLooks

FREE, UNKNOWN, OCCUPIED = 0, 1, 2
GREY: Final = (0x80, 0x86, 0x8E)
"""A grey that is legible on light and dark pages."""

OPACITY: Final = bytes((0, 30, 120))
"""Opacity of free, unknown and occupied cells."""

MOST_CELLS: Final = 2_000
"""Across, and up: about as many as a screen has pixels. A browser that shrinks more of them loses thin walls."""


class MapDescription(BaseModel):
    """The contents of a map's YAML file, in metres and radians. In the mode `raw` pixels are no shades."""

    image: Annotated[str, Field(min_length=1)]
    mode: Literal["trinary", "scale"] = "trinary"
    resolution: Annotated[float, Field(gt=0, le=1_000)]
    origin: tuple[FiniteFloat, FiniteFloat, FiniteFloat]
    negate: bool = False
    occupied_thresh: Annotated[float, Field(gt=0, le=1)]
    free_thresh: Annotated[float, Field(ge=0, lt=1)]

    @model_validator(mode="after")
    def _free_is_less(self) -> Self:
        if self.free_thresh > self.occupied_thresh:
            raise ValueError("free_thresh is over occupied_thresh")
        return self


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """An image in the map. png: transparent where the floor is free. width, height: in metres.

    x, y, yaw: where in the map its lower left corner lies, and how far it is turned there, in metres and radians.
    corners: of the part of it that is not unknown, in the map; empty if all is.
    """

    png: bytes
    width: float
    height: float
    x: float
    y: float
    yaw: float
    corners: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, shades: NDArray[np.uint16], white: int, said: MapDescription) -> Self:
        """Return the floor plan of a grey image (rows from the top, from 0 to `white`) and its description."""
        darkness = shades if said.negate else white - shades
        cells = np.full(shades.shape, UNKNOWN, np.uint8)
        cells[darkness < said.free_thresh * white] = FREE
        cells[darkness > said.occupied_thresh * white] = OCCUPIED
        drawn, step = _coarser(cells)
        resolution = said.resolution * step
        rows, columns = drawn.shape
        x, y, yaw = said.origin
        cos, sin = math.cos(yaw), math.sin(yaw)
        known = _known(drawn, resolution)
        corners = tuple((x + cos * across - sin * up, y + sin * across + cos * up) for across, up in known)
        return cls(_png(drawn), columns * resolution, rows * resolution, x, y, yaw, corners)

    @property
    def digest(self) -> str:
        """A digest of the image."""
        return hashlib.sha256(self.png).hexdigest()[:16]


FLOOR_AGES_S: Final = {60: "a minute", 600: "10 minutes", 3_600: "an hour"}
"""Ages up to which the floor has one shade, in seconds and in words: the darkest for the latest look."""

BLUE: Final = (0x2F, 0x7F, 0xD0)
LOOKED_AT: Final = bytes((0, 150, 100, 60, 30))
"""Opacity of floor that was never looked at, within each of FLOOR_AGES_S, and longer ago."""


def shades_of(looks: FloorLooks) -> NDArray[np.uint8]:
    """Return for each cell (rows x columns) the place of its age in FLOOR_AGES_S, from 1; 0 if never looked at."""
    ages = np.frombuffer(looks.ages, "<u2").reshape(looks.rows, looks.columns)
    shades = np.searchsorted(list(FLOOR_AGES_S), ages).astype(np.uint8) + np.uint8(1)
    shades[ages == LONG_AGO] = 0
    return shades


def looked_at(looks: FloorLooks) -> FloorPlan | None:
    """Return an image of when the floor was looked at, clear where it never was; None of a floor without a cell."""
    if not looks.columns or not looks.rows:
        return None
    image = _png(np.ascontiguousarray(shades_of(looks)[::-1]), BLUE, LOOKED_AT)
    size = looks.columns * looks.cell_m, looks.rows * looks.cell_m
    return FloorPlan(image, *size, *looks.origin, yaw=0.0, corners=())


def _coarser(cells: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], int]:
    """Return MOST_CELLS each way at most, occupied where they partly are, and how many times as wide each is.

    They begin in the lower left corner.
    """
    step = -(-max(cells.shape) // MOST_CELLS)
    rows, columns = (np.arange(0, size, step) for size in cells.shape)
    upwards = np.maximum.reduceat(np.maximum.reduceat(cells[::-1], rows, axis=0), columns, axis=1)
    return np.ascontiguousarray(upwards[::-1]), step


def _known(cells: NDArray[np.uint8], resolution: float) -> Iterator[tuple[float, float]]:
    """Yield the corners around the known area, in metres from the lower left corner, across and up."""
    rows, columns = (np.flatnonzero((cells != UNKNOWN).any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return
    for column in (int(columns[0]), int(columns[-1]) + 1):
        for row in (int(rows[0]), int(rows[-1]) + 1):
            yield column * resolution, (len(cells) - row) * resolution


def _png(cells: NDArray[np.uint8], colour: tuple[int, int, int] = GREY, opacity: bytes = OPACITY) -> bytes:
    image = Image.frombytes("P", cells.shape[::-1], cells.tobytes())
    image.putpalette(bytes(colour) * len(opacity))
    file = io.BytesIO()
    image.save(file, "PNG", transparency=opacity)
    return file.getvalue()


MAX_CHARACTERS: Final = 100_000
MAX_PIXELS: Final = 64_000_000
FORMATS: Final = ("PPM", "PNG", "BMP", "GIF", "TIFF")
READ_AS: Final = {"1": "L", "L": "L", "P": "RGB", "RGB": "RGB", "LA": "RGBA", "RGBA": "RGBA"}
"""The channels as which images of a Pillow mode are read."""


class FloorPlanError(Exception):
    """A floor plan is unusable; the message names the file at fault."""

    def __init__(self, file: Path, reason: str) -> None:
        super().__init__(f"floor plan {file}: {reason}")


def load_floor_plan(path: Path) -> FloorPlan:
    """Read a map's YAML file and its image.

    Raises:
        FloorPlanError: either cannot be read, or is not what map_server writes.
    """
    said = _description(path)
    image = path.parent / said.image
    try:
        return FloorPlan.of(*_shades(image, with_alpha=said.mode == "trinary"), said)
    except (UnidentifiedImageError, ImportError) as error:  # Ultralytics has Pillow look for a HEIF decoder
        raise FloorPlanError(image, "not a map image; use PGM or PNG") from error
    except Exception as error:  # damaged files make Pillow raise arbitrary errors
        raise FloorPlanError(image, _reason(error)) from error


def _description(path: Path) -> MapDescription:
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(MAX_CHARACTERS + 1)
        if len(text) > MAX_CHARACTERS:
            raise FloorPlanError(path, f"a map's YAML file has at most {MAX_CHARACTERS:,} characters")
        content: Any = yaml.load(text, Loader=yaml.BaseLoader)  # noqa: S506 - makes nothing but text, lists and dicts
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise FloorPlanError(path, f"line {line}: {error.problem}") from error
    except (OSError, UnicodeDecodeError, yaml.YAMLError, RecursionError) as error:
        raise FloorPlanError(path, _reason(error)) from error
    if not isinstance(content, dict):
        raise FloorPlanError(path, "not a map's YAML file")
    try:
        return MapDescription.model_validate(content)
    except ValidationError as error:
        mistake = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in mistake["loc"])
        reason = mistake["msg"].removeprefix("Value error, ")
        raise FloorPlanError(path, f"{place}: {reason}" if place else reason) from error


def _reason(error: Exception) -> str:
    said = error.strerror if isinstance(error, OSError) and error.strerror else " ".join(str(error).split())
    return said[:200]


def _shades(path: Path, *, with_alpha: bool) -> tuple[NDArray[np.uint16], int]:
    """Return an image as grey pixels, rows from the top, and how much white is.

    with_alpha: opacity counts as one more colour, as map_server has it.
    """
    with Image.open(path, formats=FORMATS) as image:
        if image.width * image.height > MAX_PIXELS:
            raise ValueError(f"{image.width} x {image.height} pixels: at most {MAX_PIXELS:,} are drawn")
        if image.mode not in READ_AS:
            raise ValueError(f"its pixels are {image.mode}: use 8 bits")
        mode = READ_AS[image.mode]
        read = image if image.mode == mode else image.convert(mode)
        colours = [each for each in read.getbands() if with_alpha or each != "A"]
        sums = np.zeros((image.height, image.width), np.uint16)
        for each in colours:  # one at a time, to save memory
            sums += np.asarray(read.getchannel(each))
    return sums, 255 * len(colours)
