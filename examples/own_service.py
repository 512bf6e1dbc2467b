"""A detector worker with a model of one's own: it finds what is bright.

python examples/own_service.py; FLEETSIGHT_CONNECT says where the fleet is. It shares the cameras with the detectors
that run, takes images only while somebody wants results, and publishes detections and class lists.
"""

import asyncio
from contextlib import suppress

import numpy as np
import simplejpeg
from numpy.typing import NDArray

import fleetsight
from fleetsight import Box, Detection, ImageFrame

BRIGHT = 200
"""Of 255."""


def pixels(image: ImageFrame) -> NDArray[np.uint8]:
    """Return an image's pixels: JPEG from elsewhere, raw from a gateway on the same machine."""
    if image.format == "jpeg":
        decoded: NDArray[np.uint8] = simplejpeg.decode_jpeg(image.data, colorspace="RGB")
        return decoded
    if image.format == "raw" and image.encoding in {"rgb8", "bgr8"}:
        rows = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)
        return rows[:, : image.width * 3].reshape(image.height, image.width, 3)
    raise ValueError(f"{image.header.robot}: {image.format} images of {image.encoding} are not read here")


def look(image: ImageFrame) -> list[Detection]:
    """Return the box around all bright pixels, scored by how bright they are."""
    grey = pixels(image).mean(axis=2)
    rows, columns = np.nonzero(grey > BRIGHT)
    if not rows.size:
        return []
    box = Box(float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1))
    return [Detection(name="bright", score=float(grey[rows, columns].mean() / 255), box=box)]


async def find(image: ImageFrame) -> list[Detection]:
    """Look at an image in a thread, so that the event loop goes on."""
    return await asyncio.to_thread(look, image)


async def main() -> None:
    """Serve until interrupted."""
    async with fleetsight.connect() as fleet:
        await fleet.serve_model(find, model="brightness", classes=["bright"])


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        asyncio.run(main())
