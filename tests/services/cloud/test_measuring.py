import math
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas import codec
from schemas.detections import Detections, Mask
from schemas.objects import ObjectClouds
from schemas.points import PointCloud
from services.cloud.measuring import NO_MASK, CloudLimits, measure
from services.cloud.objects import Target
from services.cloud.outlines import RegisteredView
from services.cloud.points import Points
from services.cloud.views import ProjectedView
from tests.schemas.frames import header
from tests.services.cloud.clouds import xyz_cloud
from tests.services.cloud.scenes import CAMERA, OPTICAL_IN_BASE, Cuboid, camera_view, detection, detections, lidar_view

BASE = Target("base_link", OPTICAL_IN_BASE)
BOXES = (Cuboid((4.0, 0.6), (0.6, 0.9, 0.7), yaw=0.5), Cuboid((5.0, -0.8), (1.0, 0.8, 0.8), yaw=-0.3))
COLOUR = (10, 200, 30)


def measured(cloud: PointCloud, found: Detections, *, target: Target = BASE, **limits: Any) -> ObjectClouds:
    points = Points.of(cloud)
    made = measure(
        found, RegisteredView(points), of=cloud.header, target=target, limits=CloudLimits(**limits), worker="w"
    )
    return codec.decode(ObjectClouds, codec.encode(made), codec.encoding(ObjectClouds))


def scene(noise: float = 0.0) -> tuple[PointCloud, NDArray[np.intp]]:
    points, owners = camera_view(BOXES, noise=noise)
    rgb = np.full((*owners.shape, 3), COLOUR, np.uint8)
    about = msgspec.structs.replace(header(camera="deep", seq=99), stamp_ns=5, frame_id="points_optical")
    return xyz_cloud(points, rgb, header=about), owners


def of_boxes(owners: NDArray[np.intp]) -> Detections:
    return detections(*(detection(owners == number) for number in range(1, len(BOXES) + 1)))


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_boxes_are_where_they_are_in_the_target_frame_and_in_the_sensors(noise: float) -> None:
    cloud, owners = scene(noise)
    made = measured(cloud, of_boxes(owners))
    assert (made.unmeasured, made.unknown_target) == ({}, "")
    for box, found in zip(BOXES, made.objects, strict=True):
        assert found.in_target is not None
        there = found.in_target.box
        assert there.centre[:2] == pytest.approx(box.centre, abs=0.1)
        assert there.size[2] == pytest.approx(box.size[2], rel=0.1)
        assert sorted(there.size[:2]) == pytest.approx(sorted(box.size[:2]), rel=0.15)
        assert there.up == (0, 0, 1)
        length = box.yaw + (0 if box.size[0] >= box.size[1] else math.pi / 2)
        assert abs((there.yaw - length + math.pi / 2) % math.pi - math.pi / 2) < math.radians(4)
        x, y, z = there.centre
        assert found.shape.box.centre == pytest.approx((-y, 1.5 - z, x), abs=1e-6)
        assert found.shape.box.up == pytest.approx((0, -1, 0))
        assert found.shape.box.size == there.size


def test_a_cloud_is_the_objects_own_points_with_their_colours() -> None:
    cloud, owners = scene()
    made = measured(cloud, of_boxes(owners))
    picture, _ = camera_view(BOXES)
    for number, found in enumerate(made.objects, start=1):
        xyz = np.frombuffer(found.xyz, "<f4").reshape(-1, 3)
        mine = {tuple(point) for point in picture[owners == number].tolist()}
        assert {tuple(point) for point in xyz.tolist()} <= mine
        assert found.count > 0.7 * len(mine)
        assert found.shape.centroid == pytest.approx(picture[owners == number].mean(axis=0, dtype=np.float64), abs=0.01)
        assert {tuple(rgb) for rgb in np.frombuffer(found.rgb, np.uint8).reshape(-1, 3).tolist()} == {COLOUR}
        assert (found.name, found.label, found.index) == ("box", 2, number - 1)


def test_what_the_mask_shows_behind_an_object_is_not_in_its_cloud() -> None:
    cloud, owners = scene()
    bled = owners == 1
    for _ in range(6):
        bled[1:] |= bled[:-1]
        bled[:-1] |= bled[1:]
        bled[:, 1:] |= bled[:, :-1]
        bled[:, :-1] |= bled[:, 1:]
    made = measured(cloud, detections(detection(bled)))
    (found,) = made.objects
    xyz = np.frombuffer(found.xyz, "<f4").reshape(-1, 3)
    assert (xyz[:, 2] < 5.0).all()
    exact = measured(cloud, detections(detection(owners == 1))).objects[0]
    assert found.shape.centroid == pytest.approx(exact.shape.centroid, abs=0.08)


def test_it_is_the_detections_frame_at_the_points_stamp() -> None:
    cloud, owners = scene()
    made = measured(cloud, of_boxes(owners))
    assert (made.header.camera, made.header.seq) == ("front", 7)
    assert (made.header.stamp_ns, made.header.frame_id) == (5, "points_optical")
    assert (made.model, made.worker) == ("m", "w")
    assert made.target is not None
    assert (made.target.frame_id, made.target.child_frame_id, made.target.stamp_ns) == (
        "base_link",
        "points_optical",
        5,
    )
    assert made.target.translation == (0, 0, 1.5)
    assert np.abs(made.target.rotation) == pytest.approx([0.5] * 4)


def test_without_a_target_the_reason_travels_and_up_is_the_optical_frames() -> None:
    cloud, owners = scene()
    made = measured(cloud, of_boxes(owners), target=Target("map", unknown="no transform leads from a to b"))
    assert (made.target, made.unknown_target) == (None, "no transform leads from a to b")
    assert [found.in_target for found in made.objects] == [None, None]
    assert made.objects[0].shape.box.up == (0, -1, 0)


def test_why_an_object_has_no_cloud_travels_with_the_others() -> None:
    cloud, owners = scene()
    nothing = np.zeros(owners.shape, np.bool_)
    few = nothing.copy()
    few[0, :9] = True
    found = detections(detection(nothing), detection(few), detection(None), detection(owners == 1))
    damaged = msgspec.structs.replace(found.objects[0], mask=Mask(found.objects[3].mask.size, "!!"))  # type: ignore[union-attr]
    made = measured(cloud, msgspec.structs.replace(found, objects=[*found.objects, damaged]))
    assert [each.index for each in made.objects] == [3]
    assert made.unmeasured[0] == "0 points within its mask, at least 10 are needed"
    assert made.unmeasured[1] == "9 points within its mask, at least 10 are needed"
    assert made.unmeasured[2] == NO_MASK
    assert "COCO" in made.unmeasured[4]


def black_box(factor: int) -> tuple[PointCloud, Detections]:
    """Return a scene whose first box gives no points, and what is found there, with masks 4 pixels too large."""
    picture, owners = camera_view(BOXES)
    points = np.where((owners == 1)[..., np.newaxis], np.nan, picture)[factor // 2 :: factor, factor // 2 :: factor]
    found = [detection(cv2.dilate((owners == number).astype(np.uint8), np.ones((9, 9))) > 0) for number in (1, 2)]
    return xyz_cloud(np.ascontiguousarray(points)), detections(*found)


@pytest.mark.parametrize("factor", [1, 2])
def test_an_object_that_gives_no_points_has_none_of_what_is_around_it(factor: int) -> None:
    cloud, found = black_box(factor)
    view = RegisteredView(Points.of(cloud), factor)
    made = measure(found, view, of=cloud.header, target=BASE, limits=CloudLimits(), worker="w")
    assert [each.index for each in made.objects] == [1]
    assert made.unmeasured[0].endswith(" points within its mask, all from its surroundings: it returns none itself")


def test_an_object_that_gives_no_points_has_none_of_an_unordered_cloud() -> None:
    cloud, found = black_box(1)
    view = ProjectedView(Points.of(cloud), CAMERA, np.identity(4))
    made = measure(found, view, of=cloud.header, target=BASE, limits=CloudLimits(), worker="w")
    assert [each.index for each in made.objects] == [1]
    assert made.unmeasured[0].endswith(" points within its mask, all from its surroundings: it returns none itself")


def test_points_that_are_only_scattered_are_no_object() -> None:
    points = np.full((480, 640, 3), np.nan, np.float32)
    points[:20:2, :20:2] = np.random.default_rng(0).uniform((-40, -40, 60), (40, 40, 140), (10, 10, 3))
    mask = np.zeros((480, 640), np.bool_)
    mask[:20, :20] = True
    made = measured(xyz_cloud(points), detections(detection(mask)), min_points=50)
    assert "that stand out from what is behind it" in made.unmeasured[0]


def test_of_too_many_points_some_are_kept_evenly() -> None:
    cloud, owners = scene()
    whole = measured(cloud, of_boxes(owners)).objects[0]
    some = measured(cloud, of_boxes(owners), max_points=100).objects[0]
    assert 50 < some.count <= 100
    assert some.shape.centroid == pytest.approx(whole.shape.centroid, abs=0.03)
    voxels = measured(cloud, of_boxes(owners), voxel_m=0.1).objects[0]
    xyz = np.frombuffer(voxels.xyz, "<f4").reshape(-1, 3)
    cells = np.floor((xyz - np.frombuffer(whole.xyz, "<f4").reshape(-1, 3).min(axis=0)) / np.float32(0.1))
    assert len({tuple(cell) for cell in cells.tolist()}) == len(xyz) < whole.count


def test_nothing_in_view_is_said_too() -> None:
    cloud, _ = scene()
    made = measured(cloud, detections())
    assert (made.objects, made.unmeasured) == ([], {})


def test_a_lidars_points_become_the_same_boxes() -> None:
    origin = np.array([0.1, 0.0, 1.6])
    points, owners = lidar_view(BOXES, origin)
    in_base = np.identity(4)
    in_base[:3, 3] = origin
    cloud = xyz_cloud(points[None], header=msgspec.structs.replace(header(), frame_id="lidar"))
    _, shown = camera_view(BOXES)
    seen = Points.of(cloud)
    view = ProjectedView(seen, CAMERA, np.linalg.inv(OPTICAL_IN_BASE) @ in_base)
    made = measure(
        of_boxes(shown), view, of=cloud.header, target=Target("base_link", in_base), limits=CloudLimits(), worker="w"
    )
    assert made.unmeasured == {}
    for number, (box, found) in enumerate(zip(BOXES, made.objects, strict=True), start=1):
        assert not found.rgb.nbytes
        truth = points[owners == number]
        assert np.linalg.norm(found.shape.centroid - truth.mean(axis=0)) < 0.1
        assert found.in_target is not None
        assert found.in_target.box.centre[:2] == pytest.approx(box.centre, abs=0.12)
        assert found.shape.box.up == (0, 0, 1)


def test_one_bad_object_fails_alone() -> None:
    cloud, owners = scene()
    good = of_boxes(owners)
    lost = np.zeros(owners.shape, np.bool_)
    lost[5:25, 5:25] = True
    points = np.array(camera_view(BOXES)[0])
    points[lost] = np.nan
    points[8:10, 8:10] = np.inf
    broken = xyz_cloud(points, np.full((*owners.shape, 3), COLOUR, np.uint8), header=cloud.header)
    bad = [
        detection(lost),
        detection(np.zeros(owners.shape, np.bool_)),
        msgspec.structs.replace(good.objects[0], mask=Mask((480, 640), "!!")),
    ]
    alone = measured(cloud, good)
    seen = Points.of(broken)
    found = msgspec.structs.replace(good, objects=[bad[0], good.objects[0], *bad[1:], good.objects[1]])
    made = measure(found, RegisteredView(seen), of=cloud.header, target=BASE, limits=CloudLimits(), worker="w")
    assert [each.index for each in made.objects] == [1, 4]
    assert sorted(made.unmeasured) == [0, 2, 3]
    for one, same in zip(made.objects, alone.objects, strict=True):
        assert bytes(one.xyz) == bytes(same.xyz)
        assert one.shape.centroid == pytest.approx(same.shape.centroid, abs=1e-4)
        assert one.shape.box.size == pytest.approx(same.shape.box.size, abs=1e-3)


@pytest.mark.parametrize("limits", [{"voxel_m": 0.2}, {"voxel_m": 1.0}, {"max_points": 100}])
def test_how_many_points_are_sent_changes_neither_what_is_an_object_nor_its_shape(limits: dict[str, Any]) -> None:
    cloud, owners = scene()
    few, all_ = (measured(cloud, of_boxes(owners), **each).objects for each in (limits, {}))
    assert [each.count < 110 for each in few] == [True, True]
    assert [each.shape for each in few] == [each.shape for each in all_]
