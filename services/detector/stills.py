"""Decodes still images of all supported formats to frames. Pure."""

import io
import warnings
from typing import Final

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from schemas.compression import JPEG_START, scanned_pixels
from schemas.header import Header
from schemas.image import MAX_SIDE, ImageFrame

ROBOT: Final = "still"
FORMATS: Final = ("JPEG", "PNG", "WEBP", "BMP", "GIF", "TIFF", "PPM")
MAX_PIXELS: Final = 64_000_000
"""The maximum number of pixels decoded: three bytes each."""
MAX_SCANNED_PIXELS: Final = 30 * MAX_PIXELS
"""Component-pixels that all scans of a JPEG file go over. Of libjpeg's default progressive files, those of CMYK are the
most work: 24 passes over one component."""


class StillError(ValueError):
    """Not an image, or one that is too large; the message says which."""


def frame_of(data: bytes) -> ImageFrame:
    """Decode an image file, rotated as its orientation tag says.

    Raises:
        StillError: it is none, is cut off, has more than MAX_PIXELS, or is made to take long to decode.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return _frame(_pixels(data))
    except StillError:
        raise
    except (UnidentifiedImageError, ImportError) as error:  # Ultralytics makes Pillow look for a HEIF decoder
        raise StillError(f"not an image in a supported format ({', '.join(FORMATS)})") from error
    except Exception as error:  # Pillow's readers raise whatever a damaged file leads them to
        raise StillError(f"an image that cannot be decoded: {error}") from error


def _pixels(data: bytes) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    """Return the image as height x width x RGB."""
    with Image.open(io.BytesIO(data), formats=FORMATS) as image:
        width, height = image.size
        if max(width, height) > MAX_SIDE or width * height > MAX_PIXELS:
            raise StillError(f"an image of {width}x{height} pixels is too large")
        _check_scans(image, data)
        turned = ImageOps.exif_transpose(image)
        if turned.mode.startswith("I"):  # 16 bits of grey: Pillow would make white of all above 255
            turned = Image.fromarray((np.asarray(turned) // 257).clip(0, 255).astype(np.uint8))
        return np.ascontiguousarray(turned.convert("RGB"))


def _check_scans(image: Image.Image, data: bytes) -> None:
    """Refuse files that are crafted to decode slowly."""
    if image.format == "TIFF" and "jpeg" in str(image.info.get("compression")):
        raise StillError("a TIFF file with JPEG compression is not supported; use another compression")
    if data.startswith(JPEG_START) and (work := scanned_pixels(data)) > MAX_SCANNED_PIXELS:
        raise StillError(
            f"a JPEG file whose scans go over {work} component-pixels, at most {MAX_SCANNED_PIXELS} are decoded"
        )


def _frame(rgb: "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]") -> ImageFrame:
    height, width = rgb.shape[:2]
    return ImageFrame(
        header=Header(robot=ROBOT, boot_id="", seq=0, stamp_ns=0, frame_id="", received_ns=0),
        height=height,
        width=width,
        encoding="rgb8",
        step=width * 3,
        data=rgb.reshape(-1).data,
    )
