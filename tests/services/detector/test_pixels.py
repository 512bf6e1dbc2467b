"""Every encoding of one scene gives the same picture."""

import cv2
import msgspec
import numpy as np
import pytest
import simplejpeg
from backports import zstd
from numpy.typing import NDArray

from schemas.image import BYTES_PER_PIXEL, DEPTH_ENCODINGS, ImageFrame
from services.detector.pixels import ImageDecodeError, shows_colours, small_grey_image, to_bgr
from tests.schemas.frames import header
from tests.schemas.pictures import compressed, file_of

BGR = np.array([[[1, 2, 3], [4, 5, 6]], [[7, 8, 9], [250, 251, 252]], [[0, 0, 255], [255, 0, 0]]], np.uint8)
ALPHA = np.full((3, 2, 1), 9, np.uint8)
ENCODED = {
    "bgr8": BGR,
    "rgb8": BGR[..., ::-1],
    "bgra8": np.concatenate([BGR, ALPHA], 2),
    "rgba8": np.concatenate([BGR[..., ::-1], ALPHA], 2),
}
MOSAICS = ("rggb", "bggr", "gbrg", "grbg")
CHANNEL = {"b": 0, "g": 1, "r": 2}


def frame(encoding: str, pixels: NDArray[np.uint8], padding: int = 0, *, is_bigendian: bool = False) -> ImageFrame:
    """Return a frame of the bytes of each pixel."""
    height, width = pixels.shape[:2]
    rows = np.ascontiguousarray(pixels).reshape(height, -1)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    return ImageFrame(
        header=header(),
        height=height,
        width=width,
        encoding=encoding,
        step=padded.shape[1],
        data=memoryview(padded.tobytes()),
        is_bigendian=is_bigendian,
    )


def scene() -> NDArray[np.uint8]:
    """Return a smooth picture with another colour in each corner, 48 x 64 x 3 in BGR."""
    down, across = np.mgrid[0:48, 0:64]
    return np.stack([across * 3 + 20, down * 4 + 30, 220 - across * 2 - down], 2).astype(np.uint8)


def mosaic(bgr: NDArray[np.uint8], pattern: str) -> NDArray[np.uint8]:
    """Return what a sensor behind a colour filter sees: `pattern` is its first row's two colours, then its second's."""
    seen = np.empty((*bgr.shape[:2], 1), np.uint8)
    for place, color in enumerate(pattern):
        row, column = divmod(place, 2)
        seen[row::2, column::2, 0] = bgr[row::2, column::2, CHANNEL[color]]
    return seen


def uyvy(bgr: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return two bytes a pixel, with the colour of each pair in the first of them (ITU-R BT.601, studio range)."""
    blue, green, red = (bgr[..., channel].astype(float) for channel in range(3))
    luma = 16 + (65.481 * red + 128.553 * green + 24.966 * blue) / 255
    first = 128 + (-37.797 * red - 74.203 * green + 112.0 * blue) / 255
    second = 128 + (112.0 * red - 93.786 * green - 18.214 * blue) / 255
    made = np.empty((*bgr.shape[:2], 2), float)
    made[..., 1] = luma
    made[:, 0::2, 0] = (first[:, 0::2] + first[:, 1::2]) / 2
    made[:, 1::2, 0] = (second[:, 0::2] + second[:, 1::2]) / 2
    return np.rint(made).astype(np.uint8)


def widened(eight: NDArray[np.uint8], order: str) -> NDArray[np.uint8]:
    """Return the bytes of 16-bit values as bright as the given 8-bit ones."""
    return (eight.astype(np.uint16) * 257).astype(f"{order}u2").view(np.uint8).reshape(*eight.shape[:2], -1)


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("encoding", ENCODED)
def test_every_colour_order_and_row_pitch_gives_the_same_picture(encoding: str, padding: int) -> None:
    made = to_bgr(frame(encoding, ENCODED[encoding], padding))
    assert made.flags.c_contiguous
    assert np.array_equal(made, BGR)


@pytest.mark.parametrize("padding", [0, 5])
def test_grey_is_the_same_in_every_channel(padding: int) -> None:
    made = to_bgr(frame("mono8", BGR[..., :1], padding))
    assert np.array_equal(made, np.repeat(BGR[..., :1], 3, 2))


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize(("order", "is_bigendian"), [("<", False), (">", True)])
def test_sixteen_bit_grey_is_scaled_to_eight(order: str, *, is_bigendian: bool, padding: int) -> None:
    grey = np.array([[0, 1, 128], [200, 254, 255]], np.uint8)[..., np.newaxis]
    made = to_bgr(frame("mono16", widened(grey, order), padding, is_bigendian=is_bigendian))
    assert np.array_equal(made, np.repeat(grey, 3, 2))


def close(made: NDArray[np.uint8], expected: NDArray[np.uint8], tolerance: int) -> bool:
    """Compare without the outermost two pixels, where a mosaic has no neighbours."""
    inner = np.s_[2:-2, 2:-2]
    return made.shape == expected.shape and int(cv2.absdiff(made[inner], expected[inner]).max()) <= tolerance


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("pattern", MOSAICS)
def test_a_mosaic_becomes_the_picture_it_was_made_of(pattern: str, padding: int) -> None:
    made = to_bgr(frame(f"bayer_{pattern}8", mosaic(scene(), pattern), padding))
    assert made.flags.c_contiguous
    assert close(made, scene(), tolerance=4)


@pytest.mark.parametrize(("order", "is_bigendian"), [("<", False), (">", True)])
@pytest.mark.parametrize("pattern", MOSAICS)
def test_a_sixteen_bit_mosaic_too(pattern: str, order: str, *, is_bigendian: bool) -> None:
    pixels = widened(mosaic(scene(), pattern), order)
    assert close(to_bgr(frame(f"bayer_{pattern}16", pixels, is_bigendian=is_bigendian)), scene(), tolerance=4)


@pytest.mark.parametrize("padding", [0, 5])
def test_yuv422_becomes_the_picture_it_was_made_of(padding: int) -> None:
    made = to_bgr(frame("yuv422", uyvy(scene()), padding))
    assert made.flags.c_contiguous
    assert close(made, scene(), tolerance=6)


@pytest.mark.parametrize("height", [1, 2, 3])
@pytest.mark.parametrize("encoding", sorted(set(BYTES_PER_PIXEL) - DEPTH_ENCODINGS))
def test_the_smallest_images_become_pictures_of_their_size(encoding: str, height: int) -> None:
    pixels = np.full((height, 2, BYTES_PER_PIXEL[encoding]), 9, np.uint8)
    assert to_bgr(frame(encoding, pixels)).shape == (height, 2, 3)


def test_depth_shows_no_colours() -> None:
    assert not shows_colours(frame("16UC1", np.zeros((2, 2, 2), np.uint8)))
    assert not shows_colours(frame("32FC1", np.zeros((2, 2, 4), np.uint8)))
    assert all(shows_colours(frame(name, pixels)) for name, pixels in ENCODED.items())


@pytest.mark.parametrize(
    ("encoding", "kind", "pixels"),
    [
        ("rgb8", "png", scene()),
        ("rgba8", "png", np.dstack([scene(), np.full((48, 64), 9, np.uint8)])),
        ("rgb8", "jpeg", scene()),
        ("bayer_gbrg8", "png", mosaic(scene(), "gbrg")),
        ("bayer_gbrg16", "png", mosaic(scene(), "gbrg").astype(np.uint16) * 257),
    ],
)
def test_a_compressed_picture_is_the_picture(encoding: str, kind: str, pixels: NDArray[np.uint8]) -> None:
    step = 64 * BYTES_PER_PIXEL[encoding]
    frame_of = compressed(file_of(pixels, f".{kind}"), encoding, step, kind=kind, height=48, width=64)
    assert close(to_bgr(frame_of), scene(), tolerance=12 if kind == "jpeg" else 4)


@pytest.mark.parametrize(("encoding", "wide"), [("mono8", 1), ("mono16", 257)])
def test_compressed_grey_is_the_same_in_every_channel(encoding: str, wide: int) -> None:
    grey = np.arange(24, dtype=np.uint8).reshape(4, 6)
    file = file_of(grey if wide == 1 else grey.astype(np.uint16) * wide, ".png")
    made = to_bgr(compressed(file, encoding, 6 * BYTES_PER_PIXEL[encoding]))
    assert np.array_equal(made, np.repeat(grey[..., np.newaxis], 3, 2))


def test_a_picture_lies_as_its_pixels_lie_whatever_its_file_says_of_up_and_down() -> None:
    turned = file_of(scene(), ".jpeg")
    exif = (
        b"Exif\x00\x00II*\x00\x08\x00\x00\x00\x01\x00\x12\x01\x03\x00\x01\x00\x00\x00\x06\x00\x00\x00\x00\x00\x00\x00"
    )
    turned = turned[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + turned[2:]
    assert to_bgr(compressed(turned, "rgb8", 192, kind="jpeg", height=48, width=64)).shape == (48, 64, 3)


@pytest.mark.parametrize(
    ("width", "shape"), [(8, (6, 8)), (10, (8, 10)), (16, (12, 16)), (63, (47, 63)), (99, (48, 64))]
)
@pytest.mark.parametrize("kind", ["raw", "png", "jpeg"])
def test_a_glance_is_the_picture_in_grey_and_small(kind: str, width: int, shape: tuple[int, int]) -> None:
    raw = frame("bgr8", scene())
    made = (
        raw if kind == "raw" else compressed(file_of(scene(), f".{kind}"), "rgb8", 192, kind=kind, height=48, width=64)
    )
    expected = cv2.resize(cv2.cvtColor(scene(), cv2.COLOR_BGR2GRAY), shape[::-1], interpolation=cv2.INTER_AREA)
    small = small_grey_image(made, width)
    assert small.shape == shape
    assert close(small, np.asarray(expected, np.uint8), tolerance=6)


@pytest.mark.parametrize(("size", "small"), [((3, 4000), (1, 160)), ((1, 16_384), (1, 160)), ((40, 3200), (2, 160))])
def test_a_glance_at_a_flat_picture_has_a_row_at_least(size: tuple[int, int], small: tuple[int, int]) -> None:
    height, width = size
    pixels = np.full((height, width, 3), 99, np.uint8)
    jpeg = compressed(file_of(pixels, ".jpeg"), "rgb8", width * 3, kind="jpeg", height=height, width=width)
    for made in (frame("bgr8", pixels), jpeg):
        assert small_grey_image(made, 160).shape == small
        assert np.abs(small_grey_image(made, 160).astype(int) - 99).max() <= 1


def test_a_damaged_jpeg_is_none_at_a_glance_either() -> None:
    with pytest.raises(ImageDecodeError, match="a jpeg that cannot be decoded"):
        small_grey_image(compressed(file_of(scene(), ".jpeg")[:200], "rgb8", 192, kind="jpeg", height=48, width=64), 8)


def jpeg(data: bytes) -> ImageFrame:
    return compressed(data, "rgb8", 192, kind="jpeg", height=48, width=64)


def odd_files() -> dict[str, bytes]:
    """Whole files of the same picture that libjpeg warns of, and what it says."""
    file = file_of(scene(), ".jpeg")
    scan, tables, version = file.index(b"\xff\xda"), file.index(b"\xff\xc4"), file.index(b"JFIF\0") + 5
    spectral = scan + 2 + file[scan + 3] - 3  # the last three bytes of the scan's header
    adobe = b"\xff\xee\x00\x0eAdobe\x00\x64" + bytes(4) + b"\x02"
    return {
        "9 extraneous bytes before marker 0xc4": file[:tables] + bytes(9) + file[tables:],
        "8 extraneous bytes before marker 0xd9": file[:-2] + bytes(9) + file[-2:],
        "Invalid SOS parameters": file[:spectral] + bytes(3) + file[spectral + 3 :],
        "unknown JFIF revision": file[:version] + b"\x02" + file[version + 1 :],
        "Unknown Adobe color transform": file[:2] + adobe + file[version + 9 :],
    }


@pytest.mark.parametrize("warning", odd_files())
def test_files_that_some_cameras_write_are_read_all_the_same(warning: str, capfd: pytest.CaptureFixture[str]) -> None:
    file, odd = file_of(scene(), ".jpeg"), odd_files()[warning]
    with pytest.raises(ValueError, match=warning):
        simplejpeg.decode_jpeg(odd)
    assert np.array_equal(to_bgr(jpeg(odd)), to_bgr(jpeg(file)))
    seen, wanted = small_grey_image(jpeg(odd), 8).astype(int), small_grey_image(jpeg(file), 8)
    assert seen.shape == wanted.shape == (6, 8)
    assert np.abs(seen - wanted).mean() < 2
    for cut in (odd[:-60], odd[: len(odd) * 3 // 4]):
        with pytest.raises(ImageDecodeError, match="a jpeg that cannot be decoded: "):
            to_bgr(jpeg(cut))
    assert capfd.readouterr() == ("", "")


def test_a_damaged_jpeg_is_no_half_grey_picture_and_writes_nothing_to_stderr(capfd: pytest.CaptureFixture[str]) -> None:
    file = file_of(np.random.default_rng(1).integers(0, 256, (48, 64, 3), np.uint8), ".jpeg")
    middle = len(file) // 2
    for damaged in (
        file[:-2],
        file[:middle],
        file[:middle] + b"\xff\x01" + file[middle:],
    ):
        with pytest.raises(ImageDecodeError, match="a jpeg that cannot be decoded: "):
            to_bgr(jpeg(damaged))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("size", [45, 60])
def test_a_damaged_file_is_said_to_be_one(size: int) -> None:
    data = file_of(scene(), ".png")[:size]
    with pytest.raises(ImageDecodeError, match="a png that cannot be decoded"):
        to_bgr(compressed(data, "rgb8", 192, height=48, width=64))


def zipped(of: ImageFrame, data: bytes | None = None) -> ImageFrame:
    """Return the frame as zstd data: its own, or what is given for it."""
    return msgspec.structs.replace(of, format="zstd", data=memoryview(zstd.compress(of.data) if data is None else data))


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("is_bigendian", [False, True])
def test_zstd_data_is_the_picture(padding: int, *, is_bigendian: bool) -> None:
    pixels = widened(mosaic(scene(), "rggb"), ">" if is_bigendian else "<")
    for raw in (
        frame("bayer_rggb16", pixels, padding, is_bigendian=is_bigendian),
        frame("bgr8", BGR, padding),
        frame("yuv422", uyvy(scene()), padding),
    ):
        assert np.array_equal(to_bgr(zipped(raw)), to_bgr(raw))


def test_damaged_zstd_data_is_said_to_be_that_and_never_grows_beyond_the_frame() -> None:
    whole = frame("bgr8", BGR)
    good = zstd.compress(whole.data)
    for bad in (good[:-1], good + zstd.compress(bytes(9)), good + b"x", forged(whole.data.nbytes)):
        with pytest.raises(ImageDecodeError, match="a zstd that cannot be decoded"):
            to_bgr(zipped(whole, bad))


def forged(size: int) -> bytes:
    """Return zstd data that says to hold `size` bytes, at most 255, and holds a million."""
    bomb = zstd.compress(bytes(1_000_000), options={zstd.CompressionParameter.content_size_flag: 0})
    magic, window_and_blocks = bomb[:4], bomb[5:]
    return magic + bytes([0x20, size]) + window_and_blocks[1:]
