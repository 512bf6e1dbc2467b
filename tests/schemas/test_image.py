import pytest

from schemas.errors import SchemaError
from schemas.image import BYTES_PER_PIXEL, MAX_SIDE, check_layout

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
