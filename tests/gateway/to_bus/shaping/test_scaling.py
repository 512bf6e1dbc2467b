from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from gateway.to_bus.shaping.scaling import MAX_FACTOR, ShapingError, pixels_of, scale_image, scale_info
from schemas.camera_info import CameraInfo, Region
from schemas.image import BYTES_PER_PIXEL, ImageFrame
from tests.gateway.to_bus.shaping.frames import frame, picture
from tests.schemas.frames import header
from tests.schemas.pictures import compressed, file_of

FACTORS = st.integers(1, MAX_FACTOR)


def means(pixels: NDArray[Any], factor: int) -> NDArray[np.float64]:
    """Return the mean of each whole block, block by block."""
    height, width = pixels.shape[0] // factor, pixels.shape[1] // factor
    blocks = pixels[: height * factor, : width * factor].astype(float)
    return np.asarray(blocks.reshape(height, factor, width, factor, -1).mean(axis=(1, 3)))


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize(("encoding", "channels"), [("rgb8", 3), ("bgr8", 3), ("rgba8", 4), ("bgra8", 4), ("mono8", 1)])
@given(factor=FACTORS, seed=st.integers(0, 99))
def test_colours_are_the_means_of_their_blocks(
    encoding: str, channels: int, padding: int, factor: int, seed: int
) -> None:
    pixels = np.random.default_rng(seed).integers(0, 256, (factor * 3 + 1, factor * 2 + 1, channels), np.uint8)
    made = scale_image(frame(encoding, pixels, padding=padding), factor)
    assert (made.height, made.width) == ((factor * 3 + 1) // factor, (factor * 2 + 1) // factor)
    assert made.step == made.width * channels
    assert np.array_equal(pixels_of(made), np.floor(means(pixels, factor) + 0.5))


@pytest.mark.parametrize("value", [0, 255])
def test_the_brightest_and_the_darkest_stay_so(value: int) -> None:
    made = scale_image(frame("rgb8", np.full((32, 32, 3), value, np.uint8)), 16)
    assert bytes(made.data) == bytes([value] * 12)


@pytest.mark.parametrize("is_bigendian", [False, True])
def test_sixteen_bit_grey_is_averaged_in_its_own_byte_order(*, is_bigendian: bool) -> None:
    pixels = np.array([[65535, 65535, 0, 1], [65535, 65533, 2, 3]], np.uint16)
    made = scale_image(frame("mono16", pixels, is_bigendian=is_bigendian), 2)
    assert made.is_bigendian == is_bigendian
    assert pixels_of(made)[..., 0].tolist() == [[65535, 2]]


@pytest.mark.parametrize(("encoding", "kind"), [("16UC1", np.uint16), ("32FC1", np.float32)])
@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize(("factor", "middles"), [(1, [0, 1, 2, 3, 4, 5, 6]), (2, [0, 2, 4]), (3, [1, 4])])
def test_depth_is_that_of_the_middle_of_each_block(
    encoding: str, kind: type, factor: int, middles: list[int], *, is_bigendian: bool
) -> None:
    pixels: NDArray[Any] = np.arange(49, dtype=kind).reshape(7, 7)
    made = scale_image(frame(encoding, pixels, is_bigendian=is_bigendian), factor)
    assert np.array_equal(pixels_of(made)[..., 0], pixels[np.ix_(middles, middles)])


@pytest.mark.parametrize("encoding", ["bayer_rggb8", "bayer_gbrg16"])
@pytest.mark.parametrize("factor", [1, 2, 3, 4])
def test_a_mosaic_stays_one(encoding: str, factor: int) -> None:
    kind = np.uint8 if encoding.endswith("8") else np.uint16
    places = np.tile(np.array([[1, 2], [3, 4]], kind), (12, 13))
    made = scale_image(frame(encoding, places), factor)
    assert (made.height, made.width) == (12 // factor * 2, 13 // factor * 2)
    assert np.array_equal(pixels_of(made)[..., 0], places[: made.height, : made.width])


@pytest.mark.parametrize("factor", [2, 3])
def test_yuv422_stays_pairs_of_pixels(factor: int) -> None:
    uyvy = np.empty((6, 14, 2), np.uint8)
    uyvy[..., 1], uyvy[:, 0::2, 0], uyvy[:, 1::2, 0] = np.arange(14) * 10, 50, 200
    made = scale_image(frame("yuv422", uyvy), factor)
    pixels = pixels_of(made)
    assert (made.height, made.width) == (6 // factor, 14 // (2 * factor) * 2)
    assert set(pixels[:, 0::2, 0].ravel()) == {50}
    assert set(pixels[:, 1::2, 0].ravel()) == {200}
    first = np.arange(factor) * 10
    assert pixels[0, :2, 1].tolist() == [round(first.mean() + 0.01), round((first + factor * 10).mean() + 0.01)]


@pytest.mark.parametrize("encoding", sorted(BYTES_PER_PIXEL))
def test_every_encoding_has_a_smallest_size_that_is_said(encoding: str) -> None:
    size = BYTES_PER_PIXEL[encoding]
    for side in (2, 3):
        small = ImageFrame(
            header=header(),
            height=side,
            width=2,
            encoding=encoding,
            step=size * 2,
            data=memoryview(bytes(side * size * 2)),
        )
        with pytest.raises(ShapingError, match=rf"2x{side} pixels are too few to be scaled by 1/4"):
            scale_image(small, 4)


def test_a_file_is_not_scaled() -> None:
    file = compressed(file_of(np.zeros((4, 6, 3), np.uint8), ".png"), "rgb8", 18)
    with pytest.raises(ShapingError, match="a png that arrived as one cannot be scaled"):
        scale_image(file, 2)


def info(**changes: Any) -> CameraInfo:
    made = CameraInfo(
        header=header(),
        height=480,
        width=640,
        distortion_model="plumb_bob",
        d=[0.1],
        k=[600, 0, 320, 0, 500, 240, 0, 0, 1],
        r=[1, 0, 0, 0, 1, 0, 0, 0, 1],
        p=[601, 0, 321, -60.1, 0, 501, 241, 7, 0, 0, 1, 0],
    )
    return msgspec.structs.replace(made, **changes)


def seen_at(camera: CameraInfo, x: float, y: float) -> tuple[float, float]:
    """Return the pixel in which a camera that bins and crops sees what it would see at (x, y) metres in 1 m."""
    u, v = camera.k[0] * x + camera.k[2], camera.k[4] * y + camera.k[5]
    return (
        (u - camera.roi.x_offset) / max(camera.binning_x, 1),
        (v - camera.roi.y_offset) / max(camera.binning_y, 1),
    )


@pytest.mark.parametrize("depth", [False, True])
@given(
    factor=FACTORS,
    binning=st.sampled_from([(0, 0), (1, 1), (2, 4)]),
    offset=st.tuples(st.integers(0, 99), st.integers(0, 99)),
    at=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
)
def test_a_point_is_seen_in_the_pixel_that_its_block_became(
    factor: int, binning: tuple[int, int], offset: tuple[int, int], at: tuple[float, float], *, depth: bool
) -> None:
    region = Region(x_offset=offset[0], y_offset=offset[1], width=320, height=240)
    before = info(binning_x=binning[0], binning_y=binning[1], roi=region)
    after = scale_info(before, factor, depth=depth)
    centre = (factor - 1) // 2 if depth else (factor - 1) / 2
    u, v = seen_at(before, *at)
    assert seen_at(after, *at) == pytest.approx(((u - centre) / factor, (v - centre) / factor))
    assert (after.binning_x, after.binning_y) == binning


def test_sizes_and_projections_are_those_of_the_small_picture() -> None:
    after = scale_info(info(width=641), 4, depth=False)
    assert (after.height, after.width, after.roi) == (120, 160, Region())
    assert after.k == pytest.approx([150, 0, 79.625, 0, 125, 59.625, 0, 0, 1])
    assert after.p == pytest.approx([150.25, 0, 79.875, -15.025, 0, 125.25, 59.875, 1.75, 0, 0, 1, 0])
    assert (after.d, after.r) == (info().d, info().r)


def test_a_binning_cameras_picture_has_whole_pixels() -> None:
    after = scale_info(info(binning_x=2, binning_y=2, roi=Region(width=102, height=98)), 3, depth=False)
    assert (after.roi.width // 2, after.roi.height // 2) == (102 // 2 // 3, 98 // 2 // 3)


def test_an_uncalibrated_camera_stays_so() -> None:
    after = scale_info(info(k=[0.0] * 9, p=[0.0] * 12), 2, depth=False)
    assert (after.k, after.p, after.width) == ([0.0] * 9, [0.0] * 12, 320)


def test_a_scaled_picture_fits_its_scaled_calibration() -> None:
    small = scale_image(frame("rgb8", picture(48, 64)), 3)
    after = scale_info(info(height=48, width=64), 3, depth=False)
    assert (small.height, small.width) == (after.height, after.width)
