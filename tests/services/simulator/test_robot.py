from collections import Counter
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from gateway.ros1.image import decode_image
from gateway.ros1.messages import deserialise
from gateway.ros1.point_cloud import decode_point_cloud
from services.simulator.film import Equipment, Film, Part, Store
from services.simulator.localisation import Drift, Localisation, Lost, disturbed
from services.simulator.placement import COLOR_OPTICAL, DEPTH_OPTICAL, at, of_pose
from services.simulator.robot import Robot
from services.simulator.topics import COLOR_TOPICS, Content
from services.simulator.world import Drive, generate
from tests.services.simulator.small import ALIGNED, FRAMES, HZ, PLENTY, UNALIGNED, film, robot

STAMP = 1_700_000_000_000_000_005
CLOUD = "sensor_msgs/PointCloud2"


def published(which: Robot, number: int = 1) -> dict[Content, bytes]:
    return {topic.content: message for topic, message in which.publish(number, which.topics, lambda: STAMP)}


def decoded(which: Robot, number: int = 1) -> dict[Content, Any]:
    types = {topic.content: topic.type for topic in which.topics}
    return {content: deserialise(types[content], message) for content, message in published(which, number).items()}


def placements(message: Any) -> dict[tuple[str, str], np.ndarray]:
    """Return where children are in their parents, as a reader of tf would have it."""
    found = {}
    for each in message.transforms:
        move, turn = each.transform.translation, each.transform.rotation
        x, y, z, w = turn.x, turn.y, turn.z, turn.w
        placed = at(move.x, move.y, move.z)
        placed[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        found[each.header.frame_id, each.child_frame_id] = placed
    return found


@pytest.mark.parametrize("equipment", [ALIGNED, UNALIGNED])
def test_all_of_an_instant_has_one_stamp(equipment: Equipment) -> None:
    messages = decoded(robot(equipment), number=3)
    assert messages.keys() == set(Content)
    headers = [
        message.header for content, message in messages.items() if content not in {Content.TF, Content.TF_STATIC}
    ]
    headers += [each.header for content in (Content.TF, Content.TF_STATIC) for each in messages[content].transforms]
    assert {(header.stamp.sec, header.stamp.nanosec) for header in headers} == {(1_700_000_000, 5)}
    assert {header.seq for header in headers} == {0, 3}


@pytest.mark.parametrize(
    ("equipment", "frame", "encoding", "size"),
    [(ALIGNED, COLOR_OPTICAL, "16UC1", (48, 64)), (UNALIGNED, DEPTH_OPTICAL, "32FC1", (40, 80))],
)
def test_depth_its_info_and_the_points_belong_together(
    equipment: Equipment, frame: str, encoding: str, size: tuple[int, int]
) -> None:
    messages = decoded(robot(equipment))
    color, depth = messages[Content.COLOR], messages[Content.DEPTH]
    info, points = messages[Content.DEPTH_INFO], messages[Content.POINTS]
    assert {each.header.frame_id for each in (depth, info, points)} == {frame}
    assert {(each.height, each.width) for each in (depth, info, points)} == {size}
    assert depth.encoding == encoding
    assert (color.header.frame_id, color.encoding, color.height, color.width) == (COLOR_OPTICAL, "rgb8", 48, 64)
    assert messages[Content.COLOR_INFO].header.frame_id == COLOR_OPTICAL
    assert info.K[0] == pytest.approx(equipment.depth_camera.fx)


def test_metres_without_a_reading_are_not_a_number() -> None:
    metres = decode_image(published(robot(UNALIGNED))[Content.DEPTH])
    values = np.frombuffer(metres.data, np.float32)
    kept = film(UNALIGNED).measure(1, {Part.DEPTH})[Part.DEPTH].ravel()
    assert np.array_equal(np.isnan(values), kept == 0)
    assert values[kept > 0] == pytest.approx(kept[kept > 0] / 1000, abs=1e-6)


@pytest.mark.parametrize("number", range(FRAMES))
def test_transforms_put_the_camera_where_the_picture_was_taken(number: int) -> None:
    messages = decoded(robot(), number)
    chain = placements(messages[Content.TF]) | placements(messages[Content.TF_STATIC])
    frames = ["map", "odom", "base_link", "camera_link", "camera_color_frame", COLOR_OPTICAL]
    found = np.eye(4)
    for parent, child in pairwise(frames):
        found = found @ chain[parent, child]
    assert np.allclose(found, of_pose(Drive.plan(generate(1)).pose(number / FRAMES)), atol=1e-6)


def test_localisation_errs_between_the_map_and_odometry_and_nowhere_else() -> None:
    error = Localisation(Drift(0.5, 10.0), [Lost("r1", 60.0, 80.0)])
    exact, off = robot(), Robot("r1", "", film(), robot().topics, localisation=error)
    true = placements(decoded(exact)[Content.TF])
    for second in (0.0, 61.0, 90.0):
        messages = {topic.content: data for topic, data in off.publish(1, off.topics, lambda: STAMP, second)}
        said = placements(deserialise("tf2_msgs/TFMessage", messages[Content.TF]))
        place = true["map", "odom"] @ true["odom", "base_link"]
        assert np.allclose(
            said["map", "odom"] @ said["odom", "base_link"], disturbed(place, error.error(second)), atol=1e-6
        )
        assert np.allclose(said["odom", "base_link"], true["odom", "base_link"])
        same = published(exact)
        assert {content for content, data in messages.items() if data != same[content]} == {Content.TF}


def test_each_frame_has_one_parent() -> None:
    messages = decoded(robot())
    children = Counter(
        each.child_frame_id for content in (Content.TF, Content.TF_STATIC) for each in messages[content].transforms
    )
    assert set(children.values()) == {1}
    assert {"odom", "base_link", "velodyne", "camera_depth_optical_frame"} <= children.keys()


def test_only_what_is_wanted_comes_and_transforms_come_first() -> None:
    which = robot()
    wanted = {topic for topic in which.topics if topic.content in {Content.COLOR, Content.TF}}
    assert [topic.content for topic, _ in which.publish(0, wanted, lambda: STAMP)] == [Content.TF, Content.COLOR]


def test_the_clock_is_read_once_everything_is_measured() -> None:
    store = Store(PLENTY)
    which = Robot("r1", "", Film(1, ALIGNED, FRAMES, HZ, store), COLOR_TOPICS)
    kept: list[int] = []

    def clock() -> int:
        kept.append(store.size)
        return STAMP

    which.publish(0, which.topics, clock)
    assert kept == [store.size]
    assert store.size > 0


def test_a_robot_ahead_sees_now_what_the_one_behind_sees_later() -> None:
    first, second = robot(ahead=2), robot()
    assert published(first, 1)[Content.POINTS] == published(first, 1)[Content.POINTS]
    one = decode_image(published(first, 1)[Content.COLOR])
    other = decode_image(published(second, 3)[Content.COLOR])
    assert bytes(one.data) == bytes(other.data)
    assert (one.seq, other.seq) == (1, 3)


def test_a_robots_topics_are_below_its_namespace() -> None:
    assert {which.path(which.topics[0]) for which in (robot(), robot(namespace="/r1"))} == {
        "/tf_static",
        "/r1/tf_static",
    }


def test_points_are_where_depth_says_and_have_the_pictures_colour() -> None:
    messages = published(robot())
    cloud = decode_point_cloud(messages[Content.POINTS])
    assert not cloud.is_dense
    names = {field.name: field for field in cloud.fields}
    assert {"x", "y", "z", "rgb"} <= names.keys()
    kind = np.dtype(
        {
            "names": ["x", "y", "z", "rgb"],
            "formats": ["<f4", "<f4", "<f4", "<u4"],
            "offsets": [names[name].offset for name in ("x", "y", "z", "rgb")],
            "itemsize": cloud.point_step,
        }
    )
    points = np.frombuffer(cloud.data, kind).reshape(cloud.height, cloud.width)
    depth = film().measure(1, {Part.DEPTH})[Part.DEPTH]
    picture = film().measure(1, {Part.COLOR})[Part.COLOR].astype(np.uint32)
    there = depth > 0
    assert np.array_equal(np.isfinite(points["z"]), there)
    assert points["z"][there] == pytest.approx(depth[there] / 1000)
    packed = picture[..., 0] << 16 | picture[..., 1] << 8 | picture[..., 2]
    assert np.array_equal(points["rgb"][there], packed[there])
    camera = ALIGNED.color
    columns = points["x"] / points["z"] * camera.fx + camera.cx
    rows = points["y"] / points["z"] * camera.fy + camera.cy
    expected = np.indices(depth.shape)
    assert columns[there] == pytest.approx(expected[1][there], abs=1e-3)
    assert rows[there] == pytest.approx(expected[0][there], abs=1e-3)
