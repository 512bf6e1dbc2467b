"""Writes a warehouse's floor plan for ROS's map_server, as a lidar would map it, in the frame `map`.

Source: http://wiki.ros.org/map_server#YAML_format
"""

import json
from pathlib import Path
from typing import Final

import numpy as np

from services.simulator.errors import FloorPlanError
from services.simulator.world import generate
from services.simulator.world.clearance import CELLS_PER_METRE, Clearance

FREE: Final = 254
OCCUPIED: Final = 0

DESCRIPTION: Final = """image: {image}
resolution: {resolution}
origin: [{x}, {y}, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def write_floor_plan(path: Path, seed: int) -> None:
    """Write the floor plan of the warehouse of `seed`: YAML to `path`, and the image that it names beside it.

    Raises:
        FloorPlanError: they cannot be written, or one is there already: it may be a real warehouse's.
    """
    image = path.with_suffix(".pgm")
    if there := next((file for file in (path, image) if file.exists()), None):
        raise FloorPlanError(f"--floor-plan {path}: {there} already exists")
    clearance = Clearance.of(generate(seed))
    pixels = np.where(clearance.grid[::-1] > 0, FREE, OCCUPIED).astype(np.uint8)  # the first row is the farthest
    rows, columns = pixels.shape
    description = DESCRIPTION.format(
        image=json.dumps(image.name, ensure_ascii=False),
        resolution=1 / CELLS_PER_METRE,
        x=-clearance.half_x,
        y=-clearance.half_y,
    )
    try:
        image.write_bytes(f"P5\n{columns} {rows}\n255\n".encode() + pixels.tobytes())
        path.write_text(description, encoding="utf-8")
    except OSError as error:
        raise FloorPlanError(f"--floor-plan {path}: {error.strerror or error}") from error
