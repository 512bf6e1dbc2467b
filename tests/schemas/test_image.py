import pytest

from schemas.errors import SchemaError
from schemas.image import MAX_SIDE, MAX_STEP, check_layout


@pytest.mark.parametrize(("encoding", "row"), [("rgb8", 18), ("bgr8", 18), ("rgba8", 24), ("bgra8", 24), ("mono8", 6)])
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
