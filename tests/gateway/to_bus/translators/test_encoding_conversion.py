"""Encodings that the contract does not carry arrive as the pictures and distances that OpenCV finds in them."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.ros1.image import TYPE_NAME, Image, encode_image
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.stream import MALFORMED
from gateway.to_bus.translators.encoding_conversion import CONVERTERS, OTHER_NAMES
from schemas.image import BYTES_PER_PIXEL, ImageFrame
from services.detector.pixels import to_bgr
from services.geometry.depth import read_depth
from tests.gateway.sensing import received
from tests.gateway.to_bus.translators.translating import dropped, translated

ALL_NUMBERS = np.arange(1 << 16, dtype=np.uint16)
NV = {"nv12": cv2.COLOR_YUV2BGR_NV12, "nv21": cv2.COLOR_YUV2BGR_NV21}


def sent(
    encoding: str, rows: NDArray[np.uint8], width: int, *, height: int = 0, step: int = 0, is_bigendian: bool = False
) -> Message:
    """Return an image of rows of bytes; its height is their number and its step their length unless given."""
    height, step = height or len(rows), step or rows.shape[1]
    image = Image(1, 2, 3, "lens", height, width, encoding, is_bigendian, step, memoryview(rows.tobytes()))
    return received(TYPE_NAME, encode_image(image))


def bytes_of(pixels: NDArray[np.generic], padding: int = 0, *, is_bigendian: bool = False) -> NDArray[np.uint8]:
    """Return the rows of height x width (x channels) pixels."""
    ordered = pixels.astype(pixels.dtype.newbyteorder(">" if is_bigendian else "<"))
    rows = np.ascontiguousarray(ordered).view(np.uint8).reshape(len(pixels), -1)
    return np.pad(rows, ((0, 0), (0, padding)), constant_values=77)


def random_bytes(*shape: int) -> NDArray[np.uint8]:
    return np.random.default_rng(5).integers(0, 256, shape, np.uint8)


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("encoding", ["rgb16", "bgr16", "rgba16", "bgra16"])
def test_sixteen_bits_of_colour_are_scaled_to_eight(encoding: str, padding: int, *, is_bigendian: bool) -> None:
    channels = 4 if "a" in encoding else 3
    pixels = np.stack([np.roll(ALL_NUMBERS, 9 * channel) for channel in range(channels)], 1).reshape(256, 256, channels)
    rows = bytes_of(pixels, padding, is_bigendian=is_bigendian)
    made = translated(ImageFrame, "front/color", sent(encoding, rows, 256, is_bigendian=is_bigendian))
    assert (made.encoding, made.height, made.width, made.is_bigendian) == (f"{encoding[:-2]}8", 256, 256, False)
    expected = cv2.convertScaleAbs(pixels, alpha=255 / 65535)
    assert np.array_equal(np.frombuffer(made.data, np.uint8).reshape(expected.shape), expected)


@pytest.mark.parametrize("padding", [0, 3])
def test_yuyv_is_the_picture_that_it_was(padding: int) -> None:
    pixels = random_bytes(4, 6, 2)
    made = translated(ImageFrame, "front/color", sent("yuv422_yuy2", bytes_of(pixels, padding), 6))
    assert (made.encoding, made.height, made.width, made.step) == ("yuv422", 4, 6, 12)
    assert np.array_equal(to_bgr(made), cv2.cvtColor(pixels, cv2.COLOR_YUV2BGR_YUY2))


@pytest.mark.parametrize("encoding", NV)
@pytest.mark.parametrize(
    ("padding", "height", "step"),
    [(0, 4, 0), (0, 6, 0), (0, 4, 9), (2, 4, 0), (2, 6, 0)],
    ids=["plain", "rows as height", "step of all planes", "padded", "padded, rows as height"],
)
def test_planes_are_the_picture_that_they_were(encoding: str, padding: int, height: int, step: int) -> None:
    planes = random_bytes(6, 6)
    message = sent(encoding, bytes_of(planes, padding), 6, height=height, step=step)
    made = translated(ImageFrame, "front/color", message)
    assert (made.encoding, made.height, made.width, made.step) == ("yuv422", 4, 6, 12)
    assert np.array_equal(to_bgr(made), cv2.cvtColor(planes, NV[encoding]))


@pytest.mark.parametrize(("name", "encoding"), OTHER_NAMES.items())
def test_other_names_are_the_same_pixels(name: str, encoding: str) -> None:
    rows = random_bytes(6, 16)
    once, twice = (translated(ImageFrame, "front/color", sent(said, rows, 2)) for said in (name, encoding))
    assert (once.encoding, once.height, bytes(once.data)) == (twice.encoding, twice.height, bytes(twice.data))


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("padding", [0, 3])
def test_signed_millimetres_are_readings_above_0(padding: int, *, is_bigendian: bool) -> None:
    rows = bytes_of(np.array([[-(2**15), -1, 0], [1, 500, 2**15 - 1]], np.int16), padding, is_bigendian=is_bigendian)
    made = translated(ImageFrame, "front/depth", sent("16SC1", rows, 3, is_bigendian=is_bigendian))
    assert made.encoding == "16UC1"
    found = read_depth(made).metres()
    np.testing.assert_array_equal(found, np.array([[np.nan] * 3, [0.001, 0.5, 32.767]], np.float32))


@pytest.mark.parametrize("is_bigendian", [False, True])
def test_metres_of_double_precision_are_those_of_single(*, is_bigendian: bool) -> None:
    rows = bytes_of(np.array([[0.1, 2.5, np.nan, np.inf, 1e300]]), 5, is_bigendian=is_bigendian)
    made = translated(ImageFrame, "front/depth", sent("64FC1", rows, 5, is_bigendian=is_bigendian))
    assert made.encoding == "32FC1"
    np.testing.assert_array_equal(np.frombuffer(made.data, "<f4"), np.array([0.1, 2.5, np.nan, np.inf, np.inf], "<f4"))


@pytest.mark.parametrize("is_bigendian", [False, True])
def test_sixteen_bits_of_grey_on_a_depth_stream_are_millimetres(*, is_bigendian: bool) -> None:
    rows = bytes_of(np.array([[0, 1, 65535]], np.uint16), 2, is_bigendian=is_bigendian)
    made = translated(ImageFrame, "front/depth", sent("mono16", rows, 3, is_bigendian=is_bigendian))
    assert made.encoding == "16UC1"
    np.testing.assert_array_equal(read_depth(made).metres(), np.array([[np.nan, 0.001, 65.535]], np.float32))
    assert translated(ImageFrame, "front/color", sent("mono16", rows, 3)).encoding == "mono16"


@pytest.mark.parametrize("encoding", sorted(set(CONVERTERS) - {"16SC1", "64FC1"}))
def test_a_picture_is_no_depth(encoding: str) -> None:
    assert dropped("front/depth", sent(encoding, random_bytes(6, 16), 2, height=4)) == {MALFORMED: 1}


@pytest.mark.parametrize("encoding", CONVERTERS)
@pytest.mark.parametrize(("height", "width", "step"), [(4, 2, 1), (5, 2, 0), (4, 20_000, 0), (2**32 - 1, 2**32 - 1, 1)])
def test_what_does_not_fit_is_malformed(encoding: str, height: int, width: int, step: int) -> None:
    message = sent(encoding, random_bytes(4, 16), width, height=height, step=step)
    assert dropped("front/color", message) == {MALFORMED: 1}


@pytest.mark.parametrize(("encoding", "rows", "width"), [("nv12", 6, 3), ("nv21", 6, 7), ("yuv422_yuy2", 4, 3)])
def test_pixels_that_share_colours_come_together(
    encoding: str, rows: int, width: int, caplog: pytest.LogCaptureFixture
) -> None:
    assert dropped("front/color", sent(encoding, random_bytes(rows, 8), width)) == {MALFORMED: 1}
    assert "pixels come in" in caplog.text


def test_encodings_are_carried_or_converted() -> None:
    assert not CONVERTERS.keys() & BYTES_PER_PIXEL.keys()
    assert set(OTHER_NAMES.values()) <= CONVERTERS.keys() | BYTES_PER_PIXEL.keys()
