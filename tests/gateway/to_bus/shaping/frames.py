"""Frames and clouds for tests of their shaping."""

from typing import Any

import cv2
import numpy as np
from backports import zstd
from numpy.typing import NDArray

from schemas.image import BYTES_PER_PIXEL, ImageFrame
from schemas.points import PointCloud, PointField
from tests.schemas.frames import header


def frame(encoding: str, pixels: NDArray[Any], *, padding: int = 0, is_bigendian: bool = False) -> ImageFrame:
    """Return a frame of height x width (x channels) pixels, in the byte order that is asked for."""
    wide = np.asarray(pixels, pixels.dtype.newbyteorder(">" if is_bigendian else "<"))
    rows = np.ascontiguousarray(wide).view(np.uint8).reshape(len(wide), -1)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    return ImageFrame(
        header=header(),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        step=padded.shape[1],
        data=memoryview(padded.tobytes()),
        is_bigendian=is_bigendian,
    )


def picture(height: int = 48, width: int = 64) -> NDArray[np.uint8]:
    """Return a smooth picture in RGB."""
    down, across = np.mgrid[0:height, 0:width]
    return np.stack([20 + across, 230 - down, 60 + (across + down) // 2], 2).astype(np.uint8)


def decoded(made: ImageFrame) -> NDArray[Any]:
    """Return the pixels as another program reads them, colours red first."""
    if made.format == "zstd":
        raw = np.frombuffer(zstd.decompress(made.data), np.uint8).reshape(made.height, made.step)
        return raw[:, : made.width * BYTES_PER_PIXEL[made.encoding]]
    found = cv2.imdecode(np.frombuffer(made.data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert found is not None
    if found.ndim == 3:
        found = cv2.cvtColor(found, cv2.COLOR_BGRA2RGBA if found.shape[2] == 4 else cv2.COLOR_BGR2RGB)
    return np.asarray(found)


def cloud(data: bytes = bytes(range(48)) * 10) -> PointCloud:
    """Return points of 16 bytes with an x."""
    return PointCloud(
        header=header(),
        height=1,
        width=len(data) // 16,
        fields=[PointField("x", 0, 7)],
        is_bigendian=False,
        point_step=16,
        row_step=len(data),
        data=memoryview(data),
        is_dense=True,
    )
