from typing import Any

import numpy as np
import pytest

from gateway.ros1.messages import new_message
from gateway.stream import MALFORMED
from schemas.points import MAX_FIELD_NAME, PointCloud, PointField
from tests.gateway.sensing import STAMP_NS, point_cloud
from tests.gateway.translators.translating import dropped, translated


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


def test_one_row_whose_length_its_driver_left_unset_is_all_of_the_data() -> None:
    made = translated(PointCloud, "lidar/points", point_cloud(height=1, width=6, row_step=0))
    assert (made.height, made.width, made.point_step, made.row_step) == (1, 6, 8, 48)
    assert bytes(made.data) == bytes(range(48))


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
        {"row_step": 23},
        {"row_step": 0},
        {"row_step": 0, "height": 1, "width": 7},
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
