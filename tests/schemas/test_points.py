import pytest
from backports import zstd

from schemas.errors import SchemaError
from schemas.points import VALUE_BYTES, PointCloud, PointField, check_fields, check_points, rgb_offsets
from tests.schemas.frames import header


@pytest.mark.parametrize(("height", "width"), [(0, 0), (1, 0), (0, 5), (1, 1), (480, 640)])
def test_rows_of_points_fit_exactly_and_padded(height: int, width: int) -> None:
    for row_step in (width * 16, width * 16 + 4):
        check_points(height, width, 16, row_step, row_step * height)


@pytest.mark.parametrize("height", [0, 1])
def test_an_empty_cloud_may_leave_its_layout_empty(height: int) -> None:
    check_points(height, 0, 0, 0, 0)


@pytest.mark.parametrize("size", [0, 95, 97])
def test_data_is_row_step_times_height(size: int) -> None:
    with pytest.raises(SchemaError, match=f"data does not fit: {size} bytes, row step x height is 96"):
        check_points(2, 3, 16, 48, size)


def test_a_row_holds_its_points() -> None:
    with pytest.raises(SchemaError, match="row step too short: 47 bytes, 3 points of 16 bytes need 48"):
        check_points(2, 3, 16, 47, 94)


@pytest.mark.parametrize(("height", "width", "step"), [(1, 2**32 - 1, 0), (2**32 - 1, 0, 4), (2, 0, 1)])
def test_many_points_of_no_bytes_are_absurd(height: int, width: int, step: int) -> None:
    with pytest.raises(SchemaError, match=r"absurd point step|rows without points"):
        check_points(height, width, step, 0, 0)


@pytest.mark.parametrize(("datatype", "size"), VALUE_BYTES.items())
def test_a_field_lies_within_its_point(datatype: int, size: int) -> None:
    check_fields([PointField("a", 4, datatype, 3)], 4 + 3 * size)
    with pytest.raises(SchemaError, match=f"field 'a' ends at byte {4 + 3 * size} of a point of {3 + 3 * size}"):
        check_fields([PointField("b", 0, 1), PointField("a", 4, datatype, 3)], 3 + 3 * size)


def points(data: bytes, kind: str) -> PointCloud:
    return PointCloud(
        header=header(),
        height=2,
        width=3,
        fields=[PointField("x", 0, 7)],
        is_bigendian=False,
        point_step=4,
        row_step=12,
        data=memoryview(data),
        is_dense=True,
        format=kind,
    )


def test_points_may_be_zstd_data_of_the_right_size() -> None:
    assert points(zstd.compress(bytes(24)), "zstd").format == "zstd"
    with pytest.raises(SchemaError, match="zstd data holds 25 bytes instead of 24"):
        points(zstd.compress(bytes(25)), "zstd")


def test_points_are_in_no_other_format() -> None:
    with pytest.raises(SchemaError, match="unknown format: 'draco'"):
        points(bytes(24), "draco")


@pytest.mark.parametrize(
    ("fields", "little", "big"),
    [
        ([PointField("rgb", 16, 7)], (18, 17, 16), (17, 18, 19)),
        ([PointField("rgba", 12, 6)], (14, 13, 12), (13, 14, 15)),
        ([PointField("b", 0, 2), PointField("g", 1, 2), PointField("r", 2, 2)], (2, 1, 0), (2, 1, 0)),
        ([PointField("rgb", 16, 8)], None, None),
        ([PointField("r", 0, 7), PointField("g", 4, 7), PointField("b", 8, 7)], None, None),
        ([PointField("intensity", 12, 7)], None, None),
        ([], None, None),
    ],
)
def test_where_the_colours_of_a_point_are(
    fields: list[PointField], little: tuple[int, int, int] | None, big: tuple[int, int, int] | None
) -> None:
    assert rgb_offsets(fields, is_bigendian=False) == little
    assert rgb_offsets(fields, is_bigendian=True) == big
