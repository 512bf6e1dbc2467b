"""What is near a robot as ROS messages: obstacles and markers."""

from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.ros1 import point_cloud
from gateway.ros1.messages import deserialise
from gateway.to_ros.world import (
    FAINTEST,
    LEVELS,
    MARKERS,
    MOST_POINTS,
    SPACING_M,
    marker_id,
    markers,
    obstacles,
    outline,
    world_returns,
)
from schemas import codec
from schemas.world import NearbyObjects, Seer, WorldObject

S = 1_000_000_000
NOW_NS = 1_000 * S


def known(world_id: str = "a-1", **fields: Any) -> WorldObject:
    first = WorldObject(
        id=world_id,
        site="hall",
        name="pallet",
        at=(2.0, 1.0, 0.5),
        covariance=(0.01, 0.0, 0.0, 0.01, 0.0, 0.01),
        size=(1.2, 0.8, 1.0),
        existence=0.9,
        first_ns=NOW_NS - 60 * S,
        last_ns=NOW_NS,
    )
    return msgspec.structs.replace(first, **fields)


def nearby(*objects: WorldObject, sent_ns: int = NOW_NS) -> NearbyObjects:
    return NearbyObjects(robot="r1", site="hall", frame_id="map", sent_ns=sent_ns, radius_m=15.0, objects=[*objects])


def points(message: bytes) -> NDArray[np.float32]:
    cloud = deserialise(point_cloud.TYPE_NAME, message)
    assert [field.name for field in cloud.fields] == ["x", "y", "z"]
    return np.frombuffer(bytes(cloud.data), "<f4").reshape(-1, 3)


def test_an_obstacle_is_the_sides_of_a_box() -> None:
    found = points(obstacles(nearby(known()), 1, NOW_NS))
    assert found.min(axis=0) == pytest.approx([1.4, 0.6, 0.05])
    assert found.max(axis=0) == pytest.approx([2.6, 1.4, 0.95])
    on_side = np.isclose(abs(found[:, 0] - 2), 0.6, atol=1e-5) | np.isclose(abs(found[:, 1] - 1), 0.4, atol=1e-5)
    assert on_side.all()


def test_no_gap_in_a_side_is_wider_than_a_cell_of_a_costmap() -> None:
    level = outline(known())
    front = np.sort(level[(level[:, 2] == level[0, 2]) & np.isclose(level[:, 1], 0.6)][:, 0])
    assert front[0] == pytest.approx(1.4)
    assert front[-1] == pytest.approx(2.6)
    assert np.diff(front).max() <= SPACING_M + 1e-9


def test_a_turned_box_is_turned_about_its_centre() -> None:
    found = outline(known(yaw=np.pi / 2))
    assert found.min(axis=0)[:2] == pytest.approx([1.6, 0.4])
    assert found.max(axis=0)[:2] == pytest.approx([2.4, 1.6])


def test_a_very_large_object_has_no_more_points_than_allowed() -> None:
    assert len(outline(known(size=(5_000.0, 3_000.0, 4.0)))) <= MOST_POINTS + 8 * len(LEVELS)


def test_a_flat_object_is_an_obstacle_too() -> None:
    assert np.isfinite(outline(known(size=(0.0, 0.0, 0.0)))).all()


def test_what_the_robot_itself_sees_may_be_left_out() -> None:
    mine = known("mine", seen_by=[Seer(robot="r1", camera="front", last_ns=NOW_NS - S)])
    earlier = known("earlier", at=(9.0, 0.0, 0.5), seen_by=[Seer(robot="r1", camera="front", last_ns=NOW_NS - 5 * S)])
    others = known("others", at=(20.0, 0.0, 0.5), seen_by=[Seer(robot="r2", camera="front", last_ns=NOW_NS)])
    everything = nearby(mine, earlier, others)
    assert len(points(obstacles(everything, 1, NOW_NS))) == 3 * len(outline(mine))
    assert points(obstacles(everything, 1, NOW_NS, own=False))[:, 0].min() > 8


def test_nothing_near_is_an_empty_cloud_which_clears_the_last_one() -> None:
    cloud = deserialise(point_cloud.TYPE_NAME, obstacles(nearby(), 7, NOW_NS))
    assert (cloud.width, cloud.header.frame_id, cloud.header.seq) == (0, "map", 7)


def test_each_object_has_a_box_and_a_name_with_a_lasting_id() -> None:
    first, again = (
        deserialise(MARKERS, markers(nearby(known(at=at)), 1, NOW_NS)).markers for at in ((2, 1, 0.5), (3, 1, 0.5))
    )
    box, name = first
    assert (box.ns, box.type, box.id) == ("pallet", 1, marker_id("a-1"))
    assert (name.ns, name.type, name.text) == ("pallet names", 9, "pallet a-1")
    assert [(each.ns, each.id) for each in first] == [(each.ns, each.id) for each in again]
    assert (box.scale.x, box.scale.y, box.scale.z) == (1.2, 0.8, 1.0)
    assert (box.pose.position.x, again[0].pose.position.x) == (2.0, 3.0)
    assert box.header.frame_id == "map"
    assert box.lifetime.sec > 0
    assert name.pose.position.z > 1.0


def test_the_heading_is_a_unit_quaternion() -> None:
    box, _ = deserialise(MARKERS, markers(nearby(known(yaw=1.0)), 1, NOW_NS)).markers
    turned = box.pose.orientation
    assert (turned.z, turned.w) == pytest.approx((np.sin(0.5), np.cos(0.5)))


def test_what_was_seen_long_ago_is_faint() -> None:
    fresh, old = (
        deserialise(MARKERS, markers(nearby(known(last_ns=last_ns)), 1, NOW_NS)).markers[1].color.a
        for last_ns in (NOW_NS, NOW_NS - 10_000 * S)
    )
    assert (fresh, old) == pytest.approx((1.0, FAINTEST))


def test_each_message_is_returned_once_on_each_topic() -> None:
    streams = world_returns("r1", lambda name: f"/{name}", own=True, ros_time_ns=lambda: 7 * S)
    assert [stream.topics[""] for stream in streams] == ["/fleetsight/obstacles", "/fleetsight/objects"]
    payload, encoding = codec.encode(nearby(known())), codec.encoding(NearbyObjects)
    for stream in streams:
        received = stream.receive(payload, encoding, 0)
        assert received is not None
        stream.returned(received)
        assert stream.receive(payload, encoding, 0) is None


def test_messages_have_ros_time_and_not_the_world_models() -> None:
    """A robot whose clock is another, or simulated, has no transforms at the world model's time."""
    cloud, boxes = (
        each.translator.translate(nearby(known()), 1)
        for each in world_returns("r1", str, own=True, ros_time_ns=lambda: 7 * S)
    )
    assert deserialise(point_cloud.TYPE_NAME, cloud).header.stamp.sec == 7
    assert {each.header.stamp.sec for each in deserialise(MARKERS, boxes).markers} == {7}
