from typing import Any

import numpy as np
import pytest

from gateway.ros1.messages import new_message
from gateway.to_bus.stream import MALFORMED
from schemas.points import MAX_FIELD_NAME, PointCloud, PointField
from tests.gateway.sensing import STAMP_NS, point_cloud
from tests.gateway.to_bus.translators.translating import dropped, forward, translated


def test_a_cloud_arrives_whole_and_a_count_of_none_means_one() -> None:
    made = translated(PointCloud, "lidar/points", point_cloud(is_bigendian=True, is_dense=False))
    assert (made.header.stamp_ns, made.header.frame_id) == (STAMP_NS, "lidar")
    assert (made.height, made.width, made.point_step, made.row_step) == (2, 3, 8, 24)
    assert made.fields == [PointField("x", 0, 7, 1), PointField("ring", 4, 4, 1)]
    assert (made.is_bigendian, made.is_dense) == (True, False)
    assert bytes(made.data) == bytes(range(48))


def test_a_scan_that_hit_nothing_is_a_cloud_too() -> None:
    empty = point_cloud(height=1, width=0, row_step=0, data=np.zeros(0, np.uint8))
    assert translated(PointCloud, "lidar/points", empty).width == 0


@pytest.mark.parametrize("row_step", [0, 6, 16, 24, 47, 49, 96, 2**32 - 1])
def test_one_row_is_as_long_as_its_points_are_whatever_its_driver_says(row_step: int) -> None:
    one_row = point_cloud(height=1, width=6, row_step=row_step)
    made = translated(PointCloud, "lidar/points", one_row, repaired=True)
    assert (made.height, made.width, made.point_step, made.row_step) == (1, 6, 8, 48)
    assert bytes(made.data) == bytes(range(48))


@pytest.mark.parametrize("row_step", [0, 32, 40, 2**32 - 1])
def test_bytes_behind_the_points_of_one_row_are_left_out(row_step: int) -> None:
    made = translated(PointCloud, "lidar/points", point_cloud(height=1, width=4, row_step=row_step), repaired=True)
    assert (made.width, made.row_step, bytes(made.data)) == (4, 32, bytes(range(32)))


def test_one_row_with_padding_arrives_as_it_is() -> None:
    made = translated(PointCloud, "lidar/points", point_cloud(height=1, width=4, row_step=48))
    assert (made.width, made.row_step, bytes(made.data)) == (4, 48, bytes(range(48)))


@pytest.mark.parametrize("row_step", [0, 3, 23, 25, 48, 2**32 - 1])
def test_rows_without_padding_are_as_long_as_their_points_are_whatever_their_driver_says(row_step: int) -> None:
    made = translated(PointCloud, "lidar/points", point_cloud(row_step=row_step), repaired=True)
    assert (made.height, made.width, made.row_step, bytes(made.data)) == (2, 3, 24, bytes(range(48)))


def test_bytes_behind_the_last_row_are_left_out_and_padding_that_it_lacks_is_taken_from_all_rows() -> None:
    sent = np.arange(48, dtype=np.uint8)
    longer = point_cloud(width=2, row_step=20, data=sent)
    made = translated(PointCloud, "lidar/points", longer, repaired=True)
    assert (made.row_step, bytes(made.data)) == (20, bytes(range(40)))
    shorter = point_cloud(width=2, row_step=20, data=sent[:36])
    made = translated(PointCloud, "lidar/points", shorter, repaired=True)
    assert (made.row_step, bytes(made.data)) == (16, bytes([*range(16), *range(20, 36)]))


def test_a_scan_that_hit_nothing_needs_no_data_that_fits() -> None:
    made = translated(PointCloud, "lidar/points", point_cloud(height=1, width=0, row_step=24), repaired=True)
    assert (made.width, made.row_step, bytes(made.data)) == (0, 0, b"")


def test_repairs_are_counted_and_said_ever_more_rarely(caplog: pytest.LogCaptureFixture) -> None:
    stream = forward("lidar/points")
    for _ in range(20):
        assert stream.take(point_cloud(height=1, width=6, row_step=16), 99) is not None
    status = stream.status(wanted=True, publishers=1, replaced=0, broken_links={})
    assert (status.received, status.forwarded, status.repaired, status.dropped) == (20, 20, 20, {})
    said = "/topic from /camera: sent repaired: row_step is 16 bytes and data has 48, for 1 x 6 points of 8 bytes"
    assert [text.startswith(said) for text in caplog.messages] == [True] * 5
    assert caplog.messages[-1].endswith("(16 so far)")


def field(**changes: Any) -> dict[str, Any]:
    return {
        "fields": [
            new_message("sensor_msgs/PointField", **{"name": "x", "offset": 0, "datatype": 7, "count": 1, **changes})
        ]
    }


@pytest.mark.parametrize(
    "changes",
    [
        {"height": 3},
        {"width": 4},
        {"width": 2**32 - 1, "height": 2**32 - 1},
        {"point_step": 0},
        {"row_step": 23, "data": np.arange(49, dtype=np.uint8)},
        {"row_step": 0, "data": np.arange(96, dtype=np.uint8)},
        {"row_step": 0, "height": 1, "width": 7},
        {"row_step": 48, "height": 1, "width": 7},
        {"height": 0},
        {"data": np.zeros(47, np.uint8)},
        field(datatype=0),
        field(datatype=9),
        field(offset=5),
        field(offset=2**32 - 1, count=2**32 - 1),
        field(name="x" * (MAX_FIELD_NAME + 1)),
    ],
    ids=str,
)
def test_what_does_not_fit_is_malformed(changes: dict[str, Any]) -> None:
    assert dropped("lidar/points", point_cloud(**changes)) == {MALFORMED: 1}
