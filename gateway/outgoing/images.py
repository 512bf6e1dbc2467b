"""Overlays to sensor_msgs/Image."""

from typing import Final

import simplejpeg

from gateway.ros1.image import Image, encode_image
from schemas.compression import JPEG, RAW
from schemas.errors import SchemaError
from schemas.image import ImageFrame

COLOR_SPACES: Final = {"rgb8": "RGB", "mono8": "GRAY"}
"""What a JPEG file's pixels are decoded to."""


def image(frame: ImageFrame, number: int) -> bytes:
    """Translate a raw or JPEG image; its stamp and frame are the source's, its seq the message's own.

    Raises:
        SchemaError: a file that is damaged or of another format.
        MessageError: what ROS's fields cannot hold.
    """
    data, step = (frame.data, frame.step) if frame.format == RAW else _decoded(frame)
    stamp_s, stamp_ns = divmod(frame.header.stamp_ns, 1_000_000_000)
    return encode_image(
        Image(
            seq=number,
            stamp_s=stamp_s,
            stamp_ns=stamp_ns,
            frame_id=frame.header.frame_id,
            height=frame.height,
            width=frame.width,
            encoding=frame.encoding,
            is_bigendian=frame.is_bigendian,
            step=step,
            data=data,
        )
    )


def _decoded(frame: ImageFrame) -> tuple[memoryview, int]:
    """Return pixels and the bytes of a row; the decoder's own idea of the size is checked before it takes memory."""
    if frame.format != JPEG or frame.encoding not in COLOR_SPACES:
        raise SchemaError(f"an overlay as {frame.format} of {frame.encoding} pixels: only raw and JPEG are returned")
    try:
        height, width, *_ = simplejpeg.decode_jpeg_header(frame.data)
        if (height, width) != (frame.height, frame.width):
            raise SchemaError(f"{frame.width}x{frame.height} pixels, the decoder finds {width}x{height}")
        pixels = simplejpeg.decode_jpeg(frame.data, COLOR_SPACES[frame.encoding])
    except (ValueError, KeyError) as error:  # KeyError: a subsampling that simplejpeg has no name for
        raise SchemaError(f"a JPEG file that cannot be decoded: {error!r}") from error
    return pixels.data.cast("B"), pixels.strides[0]
