import io

import numpy as np
import pytest
from PIL import Image

from schemas.compression import scanned_pixels
from services.detector.pixels import to_bgr
from services.detector.stills import MAX_PIXELS, MAX_SCANNED_PIXELS, StillError, frame_of
from tests.schemas.pictures import SCAN, resized

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


def progressive(scans: int, *, behind: bytes = b"", within: bytes = b"") -> bytes:
    """Return a photograph of so many scans. behind: what follows its end. within: what is in a segment of it."""
    data = file("JPEG", progressive=True)
    first, last = data.index(SCAN), data.rindex(SCAN)
    segment = b"\xff\xe5" + (len(within) + 2).to_bytes(2, "big") + within
    more = data[last:-2] * (scans - data.count(SCAN))
    return data[:first] + segment + data[first:-2] + more + data[-2:] + behind


def test_a_still_is_not_made_to_take_long_to_decode(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.detector.stills.MAX_SCANNED_PIXELS", (14 + 90) * 8 * 16)
    assert frame_of(progressive(100, behind=SCAN * 100, within=b"\xff\xd9" + SCAN * 100)).width == 16
    with pytest.raises(StillError, match="scans go over 13440 component-pixels, at most 13312 are decoded"):
        frame_of(progressive(101))
    for hidden in (b"\xff\xd9", SCAN):
        with pytest.raises(StillError, match="a JPEG file whose scans"):
            frame_of(progressive(101, within=hidden))


@pytest.mark.parametrize(
    ("mode", "options"), [("L", {}), ("RGB", {}), ("RGB", {"keep_rgb": True}), ("CMYK", {})], ids=str
)
def test_a_progressive_photograph_of_the_largest_size_is_no_work_too_much(mode: str, options: dict[str, bool]) -> None:
    photograph = resized(file("JPEG", PICTURE.convert(mode), progressive=True, **options), 8_000, 8_000)
    with pytest.raises(StillError, match="a JPEG file whose scans"):
        frame_of(photograph[:-2] + photograph[photograph.rindex(SCAN) : -2] * 25 + photograph[-2:])
    assert MAX_PIXELS == 8_000 * 8_000
    assert scanned_pixels(photograph) <= MAX_SCANNED_PIXELS * 0.8


def test_a_tiff_file_with_jpeg_files_inside_is_refused() -> None:
    with pytest.raises(StillError, match="a TIFF file with JPEG compression is not supported"):
        frame_of(file("TIFF", compression="jpeg"))
    assert frame_of(file("TIFF", compression="tiff_lzw")).width == 16


def test_what_is_too_large_is_refused_before_it_is_decoded() -> None:
    huge = bytearray(file("BMP"))
    huge[18:26] = (16_000).to_bytes(4, "little") + (MAX_PIXELS // 16_000 + 1).to_bytes(4, "little")
    with pytest.raises(StillError, match="is too large"):
        frame_of(bytes(huge))
