"""Overlays for tests."""

import msgspec
import numpy as np
import simplejpeg

from schemas.image import ImageFrame
from tests.schemas.frames import header

RED, BLUE = (220, 20, 30), (20, 30, 210)


def overlay(
    *, seq: int = 0, height: int = 48, width: int = 64, camera: str = "front", boot_id: str = "boot", noise: int = 0
) -> ImageFrame:
    """Return a JPEG whose left half is red and whose right half is blue; `noise` makes it hard to compress."""
    pixels = np.zeros((height, width, 3), np.uint8)
    pixels[:, : width // 2], pixels[:, width // 2 :] = RED, BLUE
    if noise:
        pixels ^= np.random.default_rng(seq).integers(0, noise, pixels.shape, np.uint8)
    return ImageFrame(
        header=msgspec.structs.replace(header(seq=seq, camera=camera), boot_id=boot_id),
        height=height,
        width=width,
        encoding="rgb8",
        step=width * 3,
        data=memoryview(simplejpeg.encode_jpeg(pixels, quality=90)),
        format="jpeg",
    )
