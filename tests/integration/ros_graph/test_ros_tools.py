"""A gateway as ROS's own tools see it, start it and feed it."""

import asyncio
import sys
from collections.abc import AsyncIterator
from itertools import pairwise
from pathlib import Path

import pytest

from bus import QoS
from schemas import codec
from schemas.detections import ClassList
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from tests.gateway.to_ros.lists import class_list
from tests.integration.fleet import PATIENCE_S, FleetRig, fleet_rig, receive
from tests.integration.peers.ros import SYSTEM_PYTHON, RosEnvironment, require_ros
from tests.integration.peers.rospy_scripts import ECHOED_CAMERA, GREY_CAMERA, LISTENER
from tests.integration.to_bus.test_first_light import write_bag
from tests.services.detector.support.views import NEAR_VIEWS, near_view
from tests.waiting import until

FRONT = CameraKey("r1", "front")
TOPIC = "/front/color/image_raw"
DROP = "/usr/lib/topic_tools/drop"
RELAY = "/usr/lib/topic_tools/relay"
ROOT = Path(__file__).parents[3]
LAUNCH = """
<launch>
  <group ns="r1">
    <remap from="/camera/color/image_raw" to="/front/color/image_raw"/>
    <node pkg="fleetsight" type="gateway.sh" name="gw" output="screen">
      <param name="unheard_of" value="1"/>
    </node>
  </group>
</launch>
"""


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def rosnode(ros: RosEnvironment, *arguments: str) -> str:
    return await (await ros.run(SYSTEM_PYTHON, "-u", "/usr/bin/rosnode", *arguments)).finished()


async def test_rosnode_pings_and_describes_a_gateway(ros: RosEnvironment, rig: FleetRig) -> None:
    require_ros("rosnode")
    await ros.script(GREY_CAMERA, "camera", TOPIC, "10")
    await rig.gateway(
        "r1", ros.master_uri, {"front": TOPIC}, "--compression", "raw", "--node-name", "gw", "--namespace", "r1"
    )
    async with rig.subscribed(FRONT.stream(Stream.COLOR)) as frames:
        await receive(frames, ImageFrame)
        assert "xmlrpc reply from http://127.0.0.1:" in await rosnode(ros, "ping", "-c", "1", "/r1/gw")
        described = await rosnode(ros, "info", "/r1/gw")
    assert "* /r1/ultralytics/detection/classes [std_msgs/String]" in described
    assert f"* {TOPIC} [sensor_msgs/Image]" in described
    assert "to: /camera (http://127.0.0.1:" in described
    assert "direction: inbound" in described
    assert "transport: TCPROS" in described


async def test_robots_with_one_master_are_told_apart_by_their_namespaces(ros: RosEnvironment, rig: FleetRig) -> None:
    for robot, grey in (("r1", 10), ("r2", 20)):
        await ros.script(GREY_CAMERA, f"camera_{robot}", f"/{robot}/color/image_raw", str(grey))
        await rig.gateway(
            robot, ros.master_uri, {"front": "color/image_raw"}, "--compression", "raw", "--namespace", robot
        )
    for robot, grey in (("r1", 10), ("r2", 20)):
        async with rig.subscribed(CameraKey(robot, "front").stream(Stream.COLOR)) as frames:
            assert (await receive(frames, ImageFrame)).data[0] == grey
        said = await rig.return_status(robot, "front")
        assert said.topic == f"/{robot}/ultralytics/detection/classes"
        info = await (await ros.rostopic("info", said.topic)).finished()
        assert info.count("* /") == 1
        assert f"* /{robot}/fleetsight_gateway_{robot}_" in info


async def test_a_roscpp_relay_feeds_a_gateway_and_takes_from_it(ros: RosEnvironment, rig: FleetRig) -> None:
    require_ros(RELAY)
    await ros.script(GREY_CAMERA, "camera", "/elsewhere", "10")
    await rig.gateway("r1", ros.master_uri, {"front": TOPIC}, "--compression", "raw")
    relay = await ros.run(RELAY, "/elsewhere", TOPIC)
    await ros.run(RELAY, "/ultralytics/detection/classes", "/copied")
    echo = await ros.rostopic("echo", "/copied")
    encoding = codec.encoding(ClassList)
    async with (
        rig.subscribed(FRONT.stream(Stream.COLOR)) as frames,
        rig.bus.publisher(FRONT.stream(Stream.CLASSES), QoS.RESULT, encoding=encoding) as classes,
    ):
        seq, shown = 0, asyncio.ensure_future(echo.until_output("['relayed']"))
        while not shown.done():
            assert (await receive(frames, ImageFrame)).data[0] == 10
            classes.put(codec.encode(class_list(("relayed", 1), seq=seq)))
            seq += 1
        await shown
        relay.kill()
        await rig.stream_status("r1", "front", lambda status: status.publishers == 0)
        await ros.run(RELAY, "/elsewhere", TOPIC)
        await rig.stream_status("r1", "front", lambda status: status.publishers == 1)


async def test_what_a_roscpp_node_drops_on_its_way_is_missing(ros: RosEnvironment, rig: FleetRig) -> None:
    require_ros(DROP)
    await ros.script(ECHOED_CAMERA, "camera", "/elsewhere", TOPIC)
    await ros.run(DROP, "/elsewhere", "1", "2", TOPIC)
    await rig.gateway("r1", ros.master_uri, {"front": TOPIC}, "--compression", "raw")
    async with rig.subscribed(FRONT.stream(Stream.COLOR)):
        status = await rig.stream_status("r1", "front", lambda status: status.received >= 5)
    assert status.missing == status.received - 1


async def test_roslaunch_starts_a_gateway_in_its_namespace(ros: RosEnvironment, rig: FleetRig, tmp_path: Path) -> None:
    require_ros("roslaunch")
    package = tmp_path / "fleetsight"
    package.mkdir()
    (package / "package.xml").write_text("<package><name>fleetsight</name></package>")
    start = package / "gateway.sh"
    python = f"PYTHONPATH={ROOT} exec {sys.executable} -m services.toolbox"
    options = f"--robot r1 --connect {rig.endpoint} --cameras camera=/camera/color/image_raw --compression raw"
    start.write_text(f'#!/bin/sh\n{python} gateway {options} "$@"\n')
    start.chmod(0o755)
    (tmp_path / "robot.launch").write_text(LAUNCH)
    await ros.script(GREY_CAMERA, "camera", TOPIC, "10")
    launched = await ros.run(
        "/usr/bin/env", f"ROS_PACKAGE_PATH={tmp_path}", "/usr/bin/roslaunch", "--screen", str(tmp_path / "robot.launch")
    )
    async with rig.subscribed(CameraKey("r1", "camera").stream(Stream.COLOR)) as frames:
        assert (await receive(frames, ImageFrame)).data[0] == 10
    assert "/r1/gw" in (await rosnode(ros, "list")).split()
    listed = (await (await ros.rostopic("list")).finished()).split()
    assert "/r1/ultralytics/detection/classes" in listed
    assert not [topic for topic in listed if topic.startswith("/ultralytics")]
    await launched.end()


@pytest.mark.parametrize(
    ("variables", "host"),
    [
        (("ROS_IP=127.0.0.2",), "127.0.0.2"),
        (("ROS_IP=127.0.0.2", "ROS_HOSTNAME=localhost"), "localhost"),
    ],
)
async def test_other_nodes_are_told_the_host_that_ros_variables_name(
    ros: RosEnvironment, rig: FleetRig, variables: tuple[str, ...], host: str
) -> None:
    gateway = ("-m", "services.toolbox", "gateway", "--robot", "r1", "--connect", rig.endpoint)
    environment = (f"PYTHONPATH={ROOT}", *variables)
    await ros.run("/usr/bin/env", *environment, sys.executable, *gateway, "--cameras", f"front={TOPIC}")
    topic = (await rig.return_status("r1", "front")).topic
    async with asyncio.timeout(PATIENCE_S):
        while f"(http://{host}:" not in (said := await (await ros.rostopic("info", topic)).finished()):
            assert "(http://" not in said
    encoding = codec.encoding(ClassList)
    listener = await ros.script(LISTENER, "listener", topic)
    async with rig.bus.publisher(FRONT.stream(Stream.CLASSES), QoS.RESULT, encoding=encoding) as classes:
        await until(lambda: classes.wanted, "the listener has connected there")
        classes.put(codec.encode(class_list(("box", 1))))
        await listener.until_output("heard ['box']")


async def test_a_bag_that_loops_takes_ros_time_back_and_frames_go_on(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path
) -> None:
    require_ros("rosparam")
    bag = tmp_path / "drive.bag"
    write_bag(bag, TOPIC, near_view(next(iter(NEAR_VIEWS))), count=5)
    await rig.gateway("r1", ros.master_uri, {"front": TOPIC}, "--compression", "raw")
    async with rig.subscribed(FRONT.stream(Stream.COLOR)) as frames:
        before = await rig.gateway_status("r1")
        assert (before.ros_time_ns, before.clock_jumps) == (None, 0)
        await (await ros.run("/usr/bin/rosparam", "set", "use_sim_time", "true")).finished()
        await ros.run("/usr/bin/rosbag", "play", "--clock", "--loop", "--quiet", str(bag))
        hz = await ros.rostopic("hz", "--wall-time", TOPIC)
        headers = [(await receive(frames, ImageFrame)).header for _ in range(12)]
        assert all(later.seq > earlier.seq for earlier, later in pairwise(headers))
        assert sum(later.stamp_ns < earlier.stamp_ns for earlier, later in pairwise(headers)) >= 2
        await hz.until_output("average rate:")
        said = await rig.gateway_status("r1", lambda status: status.clock_jumps > 0)
        assert said.ros_time_ns is not None
        assert 1_700_000_000_000_000_000 <= said.ros_time_ns < 1_700_000_010_000_000_000
