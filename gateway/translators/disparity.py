"""stereo_msgs/DisparityImage to ImageFrame: depth in metres."""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.ros1.messages import deserialise
from gateway.ros1.subscriber import Message
from gateway.translators.stream_kind import stamp_of, stamped
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.image import ImageFrame, check_layout

TYPE_NAME: Final = "stereo_msgs/DisparityImage"
DEPTH: Final = "32FC1"


def disparity(message: Message, header: Header) -> ImageFrame:
    """Translate disparities in pixels to distances in metres, NaN where there is no valid disparity above 0.

    Invalid is what lies below the message's `min_disparity`: stereo_image_proc marks pixels without a match so.
    """
    found: Any = deserialise(TYPE_NAME, message.data)
    image, reach = found.image, found.f * found.T
    if image.encoding != DEPTH:
        raise SchemaError(f"disparity as {image.encoding[:32]!r} instead of {DEPTH}")
    if not (math.isfinite(reach) and reach > 0):
        raise SchemaError(f"disparity of cameras with f = {found.f} pixels, T = {found.T} m")
    check_layout(image.height, image.width, image.encoding, image.step, image.data.nbytes)
    rows = image.data.reshape(image.height, image.step)[:, : image.width * 4]
    pixels = np.ascontiguousarray(rows).view(">f4" if image.is_bigendian else "<f4")
    depth = _metres(pixels, reach, found.min_disparity)
    return ImageFrame(
        header=stamped(header, stamp_of(found.header), found.header.frame_id),
        height=image.height,
        width=image.width,
        encoding=DEPTH,
        step=image.width * 4,
        data=depth.data.cast("B"),
    )


def _metres(disparity: NDArray[np.float32], reach: float, least: float) -> NDArray[np.float32]:
    """Return depth. least: the least valid disparity; NaN sets no limit."""
    with np.errstate(all="ignore"):
        depth = (np.float32(reach) / disparity).astype("<f4")
        depth[~((disparity > 0) & (depth > 0) & np.isfinite(depth)) | (disparity < least)] = np.nan
    return depth
