import math
import struct

import msgspec
import numpy as np
import pytest

from schemas.objects import Shape, UprightBox
from schemas.transforms import Transform
from services.monitor.live_views.object_scene import MOST_POINTS, frame_of, rounded, solids_of
from tests.schemas.results import SHAPE, cloud, clouds

UP_IN_OPTICAL = (0.0, -1.0, 0.0)


def test_points_are_drawn_in_the_target_frame() -> None:
    (solid,) = solids_of(clouds(cloud((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), rgb=bytes([255, 0, 0, 0, 255, 0]))))
    assert rounded(solid.xyz) == [[1.0, 2.0, 1.5], [2.0, 2.0, 0.5]]
    assert rounded(solid.rgb) == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    assert (solid.name, solid.count) == ("box", 2)
    assert solid.box.centre == SHAPE.box.centre  # the target frame's own
    assert frame_of(clouds()) == "map"


def test_without_a_target_a_camera_s_frame_is_turned_upright() -> None:
    shape = Shape(
        centroid=(0.0, 0.0, 2.0), box=UprightBox(centre=(1.0, 0.0, 2.0), size=(1, 1, 3), yaw=0.0, up=UP_IN_OPTICAL)
    )
    seen = msgspec.structs.replace(cloud((1.0, 0.5, 2.0)), shape=shape, in_target=None)
    without = msgspec.structs.replace(clouds(), objects=[seen], target=None, unknown_target="no tf")
    (solid,) = solids_of(without)
    assert rounded(solid.xyz) == [[2.0, -1.0, -0.5]]  # ahead, left, up
    assert solid.box.centre == (2.0, -1.0, 0.0)
    up = [row[2] for row in solid.box.rotation]
    assert up == [0.0, 0.0, 1.0]
    assert solid.distance_m == 2.0
    assert frame_of(without) == "camera_color_optical_frame"


def test_one_object_may_be_chosen_and_its_box_is_turned() -> None:
    turned = Shape(centroid=(0, 0, 1), box=UprightBox(centre=(0, 0, 1), size=(2, 1, 1), yaw=math.pi / 2))
    objects = [cloud((0, 0, 1)), msgspec.structs.replace(cloud((0, 0, 1), index=1), in_target=turned)]
    (solid,) = solids_of(clouds(*objects), only=1)
    assert [row[0] for row in solid.box.rotation] == [0.0, 1.0, 0.0]
    assert solids_of(clouds(*objects), only=5) == []
    assert solids_of(clouds()) == []


def test_what_a_browser_gets_is_bounded() -> None:
    many = struct.pack("<3f", 1, 2, 3) * (2 * MOST_POINTS)
    one = msgspec.structs.replace(cloud((0, 0, 1)), xyz=memoryview(many))
    solids = solids_of(clouds(one, one))
    assert sum(len(solid.xyz) for solid in solids) == MOST_POINTS
    assert [solid.count for solid in solids] == [2 * MOST_POINTS] * 2


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e30])
def test_what_is_no_point_is_left_out(bad: float) -> None:
    (solid,) = solids_of(clouds(cloud((bad, 0.0, 1.0), (0.0, 0.0, 1.0))))
    assert len(solid.xyz) == len(solid.rgb) == 1
    assert np.isfinite(solid.xyz).all()


def test_a_target_without_a_rotation_is_taken_as_not_turned() -> None:
    still = Transform(
        frame_id="map", child_frame_id="c", stamp_ns=5, translation=(0.0, 0.0, 1.0), rotation=(0.0, 0.0, 0.0, 0.0)
    )
    (solid,) = solids_of(msgspec.structs.replace(clouds(cloud((0.0, 0.0, 1.0))), target=still))
    assert rounded(solid.xyz) == [[0.0, 0.0, 2.0]]
