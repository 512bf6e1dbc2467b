from typing import Any

import numpy as np
import pytest
from backports import zstd

from schemas.errors import SchemaError
from schemas.image import BYTES_PER_PIXEL, MAX_SIDE, MAX_STEP, check_layout
from tests.schemas.pictures import compressed, file_of

ROWS = {
    "rgb8": 18,
    "bgr8": 18,
    "rgba8": 24,
    "bgra8": 24,
    "mono8": 6,
    "mono16": 12,
    "yuv422": 12,
    "16UC1": 12,
    "32FC1": 24,
    "bayer_rggb8": 6,
    "bayer_bggr8": 6,
    "bayer_gbrg8": 6,
    "bayer_grbg8": 6,
    "bayer_rggb16": 12,
    "bayer_bggr16": 12,
    "bayer_gbrg16": 12,
    "bayer_grbg16": 12,
}


def test_every_encoding_of_the_contract_is_covered() -> None:
    assert set(ROWS) == set(BYTES_PER_PIXEL)


def test_yuv422_has_whole_pairs_of_pixels() -> None:
    check_layout(4, 2, "yuv422", 4, 16)
    with pytest.raises(SchemaError, match="yuv422 pixels come in pairs, and a row has 3"):
        check_layout(4, 3, "yuv422", 8, 32)


@pytest.mark.parametrize(("encoding", "row"), ROWS.items())
def test_exact_and_padded_rows_fit(encoding: str, row: int) -> None:
    check_layout(4, 6, encoding, row, row * 4)
    check_layout(4, 6, encoding, row + 2, (row + 2) * 4)
    with pytest.raises(SchemaError, match="step too short"):
        check_layout(4, 6, encoding, row - 1, (row - 1) * 4)


@pytest.mark.parametrize("size", [0, 71, 73])
def test_data_is_step_times_height(size: int) -> None:
    with pytest.raises(SchemaError, match=f"data does not fit: {size} bytes, step x height is 72"):
        check_layout(4, 6, "rgb8", 18, size)


@pytest.mark.parametrize(("height", "width"), [(0, 6), (4, 0), (-1, 6), (MAX_SIDE + 1, 6), (4, MAX_SIDE + 1)])
def test_absurd_dimensions(height: int, width: int) -> None:
    with pytest.raises(SchemaError, match="absurd dimensions"):
        check_layout(height, width, "mono8", max(width, 1), max(width, 1) * height)


def test_the_largest_image_fits() -> None:
    check_layout(MAX_SIDE, MAX_SIDE, "mono8", MAX_SIDE, MAX_SIDE * MAX_SIDE)


def test_unknown_encoding() -> None:
    with pytest.raises(SchemaError, match="unknown encoding: 'rgb9'"):
        check_layout(4, 6, "rgb9", 18, 72)


def test_a_row_as_long_as_the_contract_carries() -> None:
    check_layout(1, 6, "rgb8", MAX_STEP, MAX_STEP)
    with pytest.raises(SchemaError, match="absurd step"):
        check_layout(1, 6, "rgb8", MAX_STEP + 1, MAX_STEP + 1)


COLOR_FILE = file_of(np.zeros((4, 6, 3), np.uint8), ".png")
GREY_FILE = file_of(np.zeros((4, 6), np.uint8), ".png")
DEEP_FILE = file_of(np.zeros((4, 6), np.uint16), ".png")


@pytest.mark.parametrize("encoding", ["mono16", "16UC1", "bayer_rggb16"])
def test_a_grey_file_may_be_a_mosaic_or_depth(encoding: str) -> None:
    assert compressed(DEEP_FILE, encoding, 12).format == "png"


def test_a_file_of_inverse_depth_says_how() -> None:
    assert compressed(DEEP_FILE, "32FC1", 24, inverse_depth=(1.0, 2.0)).inverse_depth == (1.0, 2.0)
    for encoding, step, said in (("32FC1", 24, None), ("16UC1", 12, (1.0, 2.0))):
        with pytest.raises(SchemaError, match="inverse depth"):
            compressed(DEEP_FILE, encoding, step, inverse_depth=said)


@pytest.mark.parametrize(
    ("data", "encoding", "step", "more", "reason"),
    [
        (COLOR_FILE, "rgb8", 18, {"kind": "jpeg"}, "format 'jpeg', the file is png"),
        (COLOR_FILE, "rgb8", 18, {"kind": "webp"}, "format 'webp', the file is png"),
        (COLOR_FILE, "bgr8", 18, {}, "bgr8 pixels, the file has rgb8"),
        (GREY_FILE, "16UC1", 12, {}, "16UC1 pixels, the file has mono8"),
        (COLOR_FILE, "rgb8", 17, {}, "step too short"),
        (COLOR_FILE, "rgb8", 18, {"height": 5}, "6x5 pixels, the file has 6x4"),
        (COLOR_FILE, "rgb8", 21, {"width": 7}, "7x4 pixels, the file has 6x4"),
        (COLOR_FILE, "rgb8", MAX_SIDE * 3, {"height": MAX_SIDE, "width": MAX_SIDE}, "bytes of pixels, at most"),
        (b"", "rgb8", 18, {}, "neither a JPEG nor a PNG"),
    ],
)
def test_a_compressed_frame_is_held_to_its_file(
    data: bytes, encoding: str, step: int, more: dict[str, Any], reason: str
) -> None:
    with pytest.raises(SchemaError, match=reason):
        compressed(data, encoding, step, **more)


def test_a_raw_frame_has_no_inverse_depth() -> None:
    with pytest.raises(SchemaError, match="inverse depth in a raw image"):
        compressed(bytes(96), "32FC1", 24, kind="raw", inverse_depth=(1.0, 2.0))


@pytest.mark.parametrize(("encoding", "step"), [("32FC1", 24), ("16UC1", 12), ("rgb8", 20)])
def test_zstd_data_holds_what_raw_data_would(encoding: str, step: int) -> None:
    assert compressed(zstd.compress(bytes(step * 4)), encoding, step, kind="zstd").step == step
    with pytest.raises(SchemaError, match=f"zstd data holds {step * 4 + 1} bytes instead of {step * 4}"):
        compressed(zstd.compress(bytes(step * 4 + 1)), encoding, step, kind="zstd")
    with pytest.raises(SchemaError, match="inverse depth in a zstd image"):
        compressed(zstd.compress(bytes(96)), "32FC1", 24, kind="zstd", inverse_depth=(1.0, 2.0))


def test_a_zstd_frame_too_large_to_be_decoded() -> None:
    with pytest.raises(SchemaError, match="bytes to be decoded, at most"):
        compressed(zstd.compress(b""), "mono8", MAX_SIDE, kind="zstd", height=MAX_SIDE, width=MAX_SIDE)
