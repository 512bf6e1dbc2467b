"""The steps of the guide's own nodes after its model, in our words: what there is to be compared with.

Masks are n x height x width float32, as Ultralytics has them; that they are numbers in torch is left out. ROS messages
are read as `ros_numpy` reads them. What the guide hands to Open3D is copied once, which is less than Open3D does.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bytes = NDArray[Any]


def distances(masks: NDArray[np.float32], depth: NDArray[Any]) -> list[float]:
    """Return the mean of the depth image's values in each mask that are not NaN, in the image's own unit."""
    means = []
    for index in range(len(masks)):
        mask = masks[index, :, :].astype(int)
        values = depth[mask == 1]
        values = values[~np.isnan(values)]
        means.append(float(np.mean(values)) if len(values) else np.inf)
    return means


def read_cloud(data: memoryview, layout: np.dtype[Any], height: int, width: int) -> tuple[Floats, Bytes]:
    """Return coordinates and colours, height x width x 3 each, 0 where nothing is measured."""
    records = np.frombuffer(data, layout)
    whole = np.ascontiguousarray(records["rgb"]).view(np.uint32)
    red, green, blue = ((whole >> shift & 255).astype(np.uint8) for shift in (16, 8, 0))
    rgb = np.stack([blue.reshape(height, width), green.reshape(height, width), red.reshape(height, width)], axis=2)
    flat = np.zeros((len(records), 3))
    for axis, name in enumerate("xyz"):
        flat[:, axis] = records[name]
    xyz = np.array(flat).reshape(height, width, 3)
    missing = np.isnan(xyz).all(axis=2)
    xyz[missing] = [0, 0, 0]
    rgb[missing] = [0, 0, 0]
    return xyz, rgb


def clouds(masks: NDArray[np.float32], xyz: Floats, rgb: Bytes) -> Iterator[tuple[Floats, Floats]]:
    """Return each object's points and colours (n, 3): all of the cloud's, those outside of the mask at the origin."""
    for index in range(len(masks)):
        mask = masks[index, :, :].astype(int)
        mask_expanded = np.stack([mask, mask, mask], axis=2)
        object_rgb = rgb * mask_expanded
        object_xyz = xyz * mask_expanded
        yield np.array(object_xyz.reshape(-1, 3)), np.array(object_rgb.reshape(-1, 3) / 255)
