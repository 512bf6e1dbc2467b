import msgspec
import numpy as np
import pytest

from bus.sharing.work_counts import Tally
from schemas.detections import Detections
from schemas.keys import CameraKey
from schemas.objects import ObjectClouds
from services.cloud.cutting import Job, apart, cut, nothing
from services.cloud.measuring import CloudLimits
from services.cloud.waiting import CloudJoiner
from tests.services.cloud.clouds import Layout, cloud_of, xyz_cloud
from tests.services.cloud.scenes import Cuboid, camera_view, detection, detections

BOXES = (Cuboid((4.0, 0.6), (0.6, 0.9, 0.7)),)


def waiting() -> CloudJoiner:
    return CloudJoiner(Tally(CameraKey("r1", "front")), target="base_link")


def test_objects_are_cut_out_with_what_is_known_of_their_instant() -> None:
    points, owners = camera_view(BOXES)
    found = detections(msgspec.structs.replace(detection(owners == 1), track=7))
    cloud = xyz_cloud(points, header=found.header)
    made = cut(Job.of(found, cloud, waiting(), "base_link"), CloudLimits(), "w")
    assert made.unknown == ""
    assert [(each.index, each.track) for each in made.clouds.objects] == [(0, 7)]
    assert made.clouds.unknown_target == "nothing is known of frame 'base_link'"


def test_one_point_of_garbage_costs_no_object() -> None:
    points, owners = camera_view(BOXES)
    points = points.copy()
    points[*np.argwhere(owners == 1)[500]] = (0.1, 0.1, 1e-42)
    found = detections(detection(owners == 1))
    made = cut(Job.of(found, xyz_cloud(points, header=found.header), waiting(), ""), CloudLimits(), "w")
    assert [each.index for each in made.clouds.objects] == [0]


def test_a_cloud_that_cannot_be_read_is_the_reason_for_every_object() -> None:
    found = detections(detection(None), detection(None))
    flat = cloud_of({"x": np.zeros((1, 3)), "y": np.zeros((1, 3))}, Layout([("x", "f4"), ("y", "f4")]))
    made = cut(Job.of(found, flat, waiting(), ""), CloudLimits(), "w")
    assert made.unknown == "a cloud without z"
    assert made.clouds.unmeasured == {0: "a cloud without z", 1: "a cloud without z"}
    assert (made.clouds.header, made.clouds.worker) == (found.header, "w")


@pytest.mark.parametrize("count", [0, 3])
def test_nothing_is_said_of_each_object(count: int) -> None:
    made = nothing(detections(*[detection(None)] * count), "no points arrived", "w")
    assert made.clouds.unmeasured == dict.fromkeys(range(count), "no points arrived")
    assert msgspec.structs.asdict(made.clouds)["objects"] == []


def test_an_object_that_cannot_be_measured_costs_no_other() -> None:
    points, owners = camera_view(BOXES)
    found = detections(detection(owners == 1), detection(None), detection(owners == 1), detection(owners == 1))
    whole = cut(Job.of(found, xyz_cloud(points, header=found.header), waiting(), ""), CloudLimits(), "w").clouds

    def measured(of: Detections) -> ObjectClouds:
        masked = {index for index, each in enumerate(of.objects) if each.mask is not None}
        if 2 in masked:
            raise ZeroDivisionError("2")
        objects = [each for each in whole.objects if each.index in masked]
        return msgspec.structs.replace(
            whole, objects=objects, unmeasured={index: "no mask" for index in range(4) if index not in masked}
        )

    made = apart(found, measured)
    assert [each.index for each in made.objects] == [0, 3]
    assert made.unmeasured == {1: "no mask", 2: "it failed: ZeroDivisionError('2')"}
