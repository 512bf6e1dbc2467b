import io

import numpy as np
import pytest
from PIL import Image

from services.detector.pixels import to_bgr
from services.detector.stills import MAX_PIXELS, StillError, frame_of

PICTURE = Image.fromarray(np.tile(np.array([[[250, 10, 20], [20, 30, 240]]], np.uint8), (6, 4, 1)).repeat(2, axis=1))


def file(kind: str, picture: Image.Image = PICTURE, **options: object) -> bytes:
    buffer = io.BytesIO()
    picture.save(buffer, kind, **options)
    return buffer.getvalue()


@pytest.mark.parametrize("kind", ["PNG", "BMP", "TIFF", "PPM", "GIF"])
def test_every_format_without_loss_gives_the_same_picture(kind: str) -> None:
    frame = frame_of(file(kind))
    assert (frame.height, frame.width, frame.encoding) == (6, 16, "rgb8")
    assert np.array_equal(to_bgr(frame)[..., ::-1], np.asarray(PICTURE))


@pytest.mark.parametrize("kind", ["JPEG", "WEBP"])
def test_formats_with_loss_too(kind: str) -> None:
    assert frame_of(file(kind)).width == 16


def test_grey_palettes_and_transparency_become_colours() -> None:
    for mode in ("L", "P", "RGBA", "1", "CMYK"):
        kind = "JPEG" if mode == "CMYK" else "PNG"
        assert to_bgr(frame_of(file(kind, PICTURE.convert(mode)))).shape == (6, 16, 3)


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "PPM"])
def test_sixteen_bits_become_eight(kind: str) -> None:
    grey = np.linspace(0, 65535, 6 * 16).astype(np.uint16).reshape(6, 16)
    pixels = to_bgr(frame_of(file(kind, Image.fromarray(grey))))
    assert np.abs(pixels[..., 0] - grey / 257).max() <= 1


def test_a_photograph_is_turned_as_it_says() -> None:
    turned = Image.Exif()
    turned[0x0112] = 6
    assert (frame_of(file("JPEG", exif=turned)).height, frame_of(file("JPEG", exif=turned)).width) == (16, 6)


@pytest.mark.parametrize("data", [b"", b"no image", file("PNG")[:-30], file("JPEG")[:200], file("BMP")[:60]])
def test_what_cannot_be_decoded_is_refused(data: bytes) -> None:
    with pytest.raises(StillError):
        frame_of(data)


@pytest.mark.parametrize(("place", "value"), [(29, 0), (31, 1)])
def test_damaged_remarks_on_a_photograph_are_refused(place: int, value: int) -> None:
    about = Image.Exif()
    about[0x0112], about[0x011A] = 6, 72.0
    damaged = bytearray(file("JPEG", exif=about))
    damaged[damaged.index(b"Exif") + place] = value
    with pytest.raises(StillError, match="cannot be decoded"):
        frame_of(bytes(damaged))


def test_what_is_too_large_is_refused_before_it_is_decoded() -> None:
    huge = bytearray(file("BMP"))
    huge[18:26] = (16_000).to_bytes(4, "little") + (MAX_PIXELS // 16_000 + 1).to_bytes(4, "little")
    with pytest.raises(StillError, match="is too large"):
        frame_of(bytes(huge))
