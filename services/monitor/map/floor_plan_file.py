"""Reads floor plans in the format of ROS's map_server: a YAML file that places a grey image in the map."""

from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from pydantic import ValidationError

from services.monitor.map.floor_plan import FloorPlan, MapDescription

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
