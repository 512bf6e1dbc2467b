"""Simulated robots as Debian's real ROS 1 sees them: rospy, tf2, rosbag, and a gateway behind rosbag."""

import hashlib
import json
import logging
from pathlib import Path

import numpy as np
import pytest

from schemas.camera_info import CameraInfo
from schemas.image import ImageFrame
from schemas.keys import TF_STATIC, CameraKey, RobotStreamKey, Stream
from schemas.points import PointCloud
from schemas.transforms import Transforms
from services.geometry.rotation import quaternion_of
from services.simulator.fleet import robots
from services.simulator.placement import COLOR_OPTICAL, DEPTH_OPTICAL, LIDAR
from services.simulator.settings import SimulatorSettings
from services.toolbox.demo.children import child
from tests.integration.fleet import fleet_rig, receive
from tests.integration.peers.ros import RosEnvironment, require_ros
from tests.integration.peers.rospy_scripts import IMAGE_LISTENER, INSTANTS

log = logging.getLogger(__name__)

SIZES = {"width": 64, "height": 48, "depth_width": 80, "depth_height": 40, "frames": 8}
SMALL = [option for name, value in SIZES.items() for option in (f"--{name.replace('_', '-')}", str(value))]
TOPICS = {
    "/camera/color/image_raw": "Image",
    "/camera/color/camera_info": "CameraInfo",
    "/camera/depth/image_rect_raw": "Image",
    "/camera/depth/camera_info": "CameraInfo",
    "/camera/depth/color/points": "PointCloud2",
    "/velodyne_points": "PointCloud2",
}


async def test_robots_share_a_real_master_each_under_its_own_name(ros: RosEnvironment) -> None:
    options = ["simulate", "--robots", "2", "--hz", "10", "--width", "64", "--height", "48", "--frames", "1"]
    async with child("simulator", [*options, "--ros-master", ros.master_uri], log.info):
        listener = await ros.script(IMAGE_LISTENER, "/r2/camera/color/image_raw")
        await listener.until_output("image 64 48 rgb8 camera_color_optical_frame")
        await listener.until_output("\nimage")
        listed = await (await ros.rostopic("list")).finished()
        assert {"/r1/camera/color/image_raw", "/r2/camera/color/image_raw", "/r1/tf"} <= set(listed.split())
        kind = await (await ros.rostopic("type", "/r1/camera/color/image_raw")).finished()
        assert kind.strip() == "sensor_msgs/Image"
        shown = [line.split()[-1] for line in listener.output.splitlines() if line.startswith("image")]
        assert set(shown) != {hashlib.sha256(b"").hexdigest()}
        await listener.end()
    gone = await (await ros.rostopic("list")).finished()
    assert "/r1/camera/color/image_raw" not in gone


async def test_rospy_gets_every_topic_with_one_stamp_and_tf2_says_where_it_was_measured(ros: RosEnvironment) -> None:
    require_ros("tf2_ros")
    options = ["simulate", "--hz", "5", "--seed", "3", "--no-align-depth", *SMALL, "--ros-master", ros.master_uri]
    async with child("simulator", options, log.info):
        listener = await ros.script(INSTANTS, "2", *(f"{topic}={kind}" for topic, kind in TOPICS.items()))
        said = await listener.finished()
    instants = [json.loads(line.removeprefix("instant ")) for line in said.splitlines() if line.startswith("instant ")]
    assert len(instants) >= 2, said
    (robot,) = robots(SimulatorSettings.model_validate({**SIZES, "seed": 3}), namespaced=False)
    for heads, found, _ in instants:
        assert {frame for _, frame, _, _ in heads.values()} == {COLOR_OPTICAL, DEPTH_OPTICAL, LIDAR}
        (number,) = {seq for seq, _, _, _ in heads.values()}
        assert heads["/camera/color/image_raw"][2:] == heads["/camera/color/camera_info"][2:] == [48, 64]
        assert heads["/camera/depth/image_rect_raw"][2:] == heads["/camera/depth/color/points"][2:] == [40, 80]
        for frame, (x, y, z, *rotation) in found.items():
            expected = robot.film.robot(number) @ robot.film.rig.on_robot(frame)
            assert (x, y, z) == pytest.approx(tuple(expected[:3, 3]), abs=1e-6)
            assert abs(np.dot(rotation, quaternion_of(expected))) == pytest.approx(1, abs=1e-9)


async def test_real_rosbag_reads_and_plays_a_bag_and_a_gateway_takes_it(ros: RosEnvironment, tmp_path: Path) -> None:
    bag = tmp_path / "out.bag"
    async with child("simulator", ["simulate", "--hz", "8", *SMALL, "--bag", str(bag)], log.info) as writing:
        await writing.process.wait()
        assert writing.process.returncode == 0
    info = await (await ros.run("/usr/bin/rosbag", "info", str(bag))).finished()
    for topic in ("/camera/color/image_raw", "/camera/aligned_depth_to_color/camera_info", "/velodyne_points", "/tf"):
        assert f" {topic} " in info
    assert "duration:    0.9s" in info
    checked = await ros.run("/usr/bin/rosbag", "check", str(bag))
    assert "No rule" not in (said := await checked.finished())
    assert "Bag file does not need any migrations" in said or "All rules defined" in said
    camera = CameraKey("r1", "camera")
    async with fleet_rig() as rig:
        await rig.gateway("r1", ros.master_uri, {})
        await ros.run("/usr/bin/rosbag", "play", "--loop", "--quiet", str(bag))
        await rig.stream_topics("r1", lambda topics: len(topics) == 8)
        async with (
            rig.subscribed(camera.stream(Stream.COLOR)) as colors,
            rig.subscribed(camera.stream(Stream.DEPTH)) as depths,
            rig.subscribed(camera.stream(Stream.DEPTH_INFO)) as infos,
            rig.subscribed(CameraKey("r1", "velodyne").stream(Stream.POINTS)) as sweeps,
            rig.subscribed(str(RobotStreamKey("r1", TF_STATIC))) as transforms,
        ):
            assert (await receive(colors, ImageFrame)).header.frame_id == COLOR_OPTICAL
            assert (await receive(depths, ImageFrame)).encoding == "16UC1"
            assert (await receive(infos, CameraInfo)).width == 64
            assert [field.name for field in (await receive(sweeps, PointCloud)).fields][-1] == "time"
            assert {COLOR_OPTICAL, LIDAR} <= {
                each.child_frame_id for each in (await receive(transforms, Transforms)).transforms
            }
