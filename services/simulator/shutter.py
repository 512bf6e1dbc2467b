"""What a camera's own motion does to its picture while the shutter is open. Pure."""

from math import ceil
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.simulator.world import Camera, Pose, Rendering

Floats = NDArray[np.float32]
Image = NDArray[np.uint8]

EXPOSURE_S: Final = 0.008
"""As in a lit hall; 30 images a second leave a D435's colour camera no more than 33 ms."""
LONGEST_RAD: Final = float(np.radians(1.0))
"""The longest streak, seen from the camera: automatic exposure is shorter where the picture moves faster."""


def smeared(seen: Rendering, camera: Camera, opened: Pose, closed: Pose) -> Image:
    """Return RGB (h, w, 3) of a shutter that is open from one pose to another, `seen` from halfway between them.

    Each pixel is smeared as its own surface moves. Where no streak is longer than a pixel, it is the picture seen.
    """
    across, down = streaks(seen.depth, camera, opened, closed)
    longest = float(cv2.magnitude(across, down).max())
    length = min(longest, LONGEST_RAD * camera.fx)
    if length <= 1:
        return seen.color
    count = ceil(length)
    places: Floats = np.indices(seen.depth.shape, np.float32)
    color = cv2.cvtColor(seen.color, cv2.COLOR_RGB2RGBA)  # four channels are moved in half the time of three
    light = np.zeros(color.shape, np.float32)
    for number in range(count):
        part = ((number + 0.5) / count - 0.5) * length / longest
        x, y = cv2.scaleAdd(across, part, places[1]), cv2.scaleAdd(down, part, places[0])
        cv2.accumulate(cv2.remap(color, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), light)
    mean = cv2.convertScaleAbs(light, alpha=1 / count)
    return np.asarray(cv2.cvtColor(mean, cv2.COLOR_RGBA2RGB), np.uint8)


def streaks(depth: Floats, camera: Camera, opened: Pose, closed: Pose) -> tuple[Floats, Floats]:
    """Return by how many pixels each pixel's surface goes to the right and down between two poses near each other.

    depth: metres along the optical axis, (h, w), 0 for what is too far away to have any.
    """
    turn = (closed.rotation - opened.rotation).T @ opened.rotation
    move = closed.rotation.T @ (opened.position - closed.position)
    x = (np.arange(camera.width, dtype=np.float32) - np.float32(camera.cx)) / np.float32(camera.fx)
    y = (np.arange(camera.height, dtype=np.float32)[:, None] - np.float32(camera.cy)) / np.float32(camera.fy)
    nearness = np.divide(1, depth, out=np.zeros_like(depth), where=depth > 0)
    right, below, ahead = (
        turn[axis, 0] * x + turn[axis, 1] * y + turn[axis, 2] + move[axis] * nearness for axis in range(3)
    )
    return np.float32(camera.fx) * (right - x * ahead), np.float32(camera.fy) * (below - y * ahead)
