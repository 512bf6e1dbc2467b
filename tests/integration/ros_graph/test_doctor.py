"""The doctor beside real robots: rosmaster, rospy publishers dead and alive, a real gateway, a router."""

import asyncio
import json
import os
import signal
import sys
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from gateway.ros1.messages import message_type
from gateway.ros1.wire.header import encode_header
from gateway.ros1.xmlrpc.client import XmlRpcClient
from schemas.keys import CameraKey, Stream
from services.simulator.ros_master.master import RosMaster
from tests.gateway.ros1.support.fakes import fake_publisher
from tests.integration.fleet import FleetRig, fleet_rig
from tests.integration.peers.ros import PEERS, RosEnvironment, free_port, require_ros

SCRIPT = (PEERS / "rospy_doctored.py").read_text(encoding="utf-8")
CLOUD = (PEERS / "rospy_cloud.py").read_text(encoding="utf-8")
ROOT = Path(__file__).parents[3]
CAMERAS = {"front": "/front/color/image_raw"}
DEPTH = ("--topics", "front/depth=/front/depth/image_raw")
IMAGE = "sensor_msgs/Image"


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


@dataclass(frozen=True)
class Report:
    """What the doctor printed and how it ended."""

    code: int
    findings: list[dict[str, str]]

    def said(self, subject: str, severity: str = "problem") -> str:
        """Return what was said of a subject; a stream may go by its name alone."""
        return "; ".join(
            each["what"]
            for each in self.findings
            if each["severity"] == severity and subject in {each["subject"], each["subject"].partition(" (")[0]}
        )

    @property
    def problems(self) -> list[str]:
        return [each["subject"] for each in self.findings if each["severity"] == "problem"]


async def fleet(endpoint: str) -> Report:
    """Run `fleetsight doctor` as a person who wants to know which robots there are."""
    return await _report("--connect", endpoint, "--seconds", "2.5", "--json")


async def doctor(master: str, cameras: Mapping[str, str], endpoint: str, *options: str) -> Report:
    """Run `fleetsight doctor` as a person would."""
    names = [option for camera, topic in cameras.items() for option in ("--cameras", f"{camera}={topic}")]
    where = ["--ros-master", master, "--ros-host", "127.0.0.1", "--connect", endpoint]
    bounds = ["--seconds", "1.5", "--json"]
    return await _report("--robot", "r1", *where, *names, *bounds, *options)


async def _report(*options: str) -> Report:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "services.toolbox", "doctor", *options),
        cwd=ROOT,
        env={name: value for name, value in os.environ.items() if not name.startswith(("ROS_", "FLEETSIGHT_"))},
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    async with asyncio.timeout(30):
        out, err = await process.communicate()
    assert err == b""
    assert process.returncode is not None
    report: dict[str, Any] = json.loads(out)
    assert report["ok"] == (process.returncode == 0)
    return Report(process.returncode, report["findings"])


async def register(master: str, topic: str, uri: str) -> None:
    """Register a publisher of images that is no rospy."""
    async with XmlRpcClient() as client:
        await client.call(master, "registerPublisher", f"/fake{topic.replace('/', '_')}", topic, IMAGE, uri)


@pytest.mark.timeout(120)
async def test_a_robot_with_everything_that_can_go_wrong(ros: RosEnvironment, rig: FleetRig) -> None:
    camera = await ros.script(
        SCRIPT, "camera", "/front/color/image_raw=color", "/odd=unknown", "/mute=silent", "/mode=text"
    )
    killed = await ros.script(SCRIPT, "killed", "/dead=color", "/front/color/image_raw=color")
    await camera.until_output("publishers up")
    await killed.until_output("publishers up")
    killed.kill()
    other_version = encode_header(
        {"type": IMAGE, "md5sum": "0" * 32, "callerid": "/old", "message_definition": message_type(IMAGE).definition}
    )
    cameras = {
        **CAMERAS,
        **{name: f"/{name}" for name in ("dead", "odd", "mute", "mode", "old", "lost")},
        "typo": "/front/colour/image_raw",
    }
    await rig.gateway("r1", ros.master_uri, cameras)
    async with fake_publisher(other_version, hang=True) as uri:
        await register(ros.master_uri, "/old", uri)
        await register(ros.master_uri, "/lost", "http://no-such-robot.invalid:40000/")
        report = await doctor(ros.master_uri, cameras, rig.endpoint)
    assert report.code == 1
    assert "nothing listens: killed, or address wrong" in report.said("dead/color")
    assert "nothing listens: killed, or address wrong" in report.said("front/color", "note")
    assert "messages/s, 9267 bytes each" in report.said("front/color", "ok")
    assert "unknown encoding: 'rgb9'" in report.said("odd/color")
    assert "sent nothing in 1.5 s" in report.said("mute/color")
    assert "is a std_msgs/String, which the stream cannot carry" in report.said("mode/color")
    assert "another version of sensor_msgs/Image" in report.said("old/color")
    assert "no-such-robot.invalid, a name that does not resolve" in report.said("lost/color")
    assert report.said("typo/color") == "no such topic exists"
    assert len(report.problems) == 7


@pytest.mark.timeout(120)
async def test_a_healthy_robot_whose_streams_somebody_wants(ros: RosEnvironment, rig: FleetRig) -> None:
    require_ros("tf2_msgs")
    topics = ("/front/color/image_raw=color", "/front/color/camera_info=info", "/front/depth/image_raw=depth")
    camera = await ros.script(SCRIPT, "camera", *topics, "/tf_static=static")
    await camera.until_output("publishers up")
    await rig.gateway("r1", ros.master_uri, CAMERAS, *DEPTH)
    async with rig.subscribed(CameraKey("r1", "front").stream(Stream.COLOR)):
        await rig.stream_status("r1", "front", lambda status: status.forwarded > 0)
        report = await doctor(ros.master_uri, CAMERAS, rig.endpoint, *DEPTH)
    assert (report.code, report.problems) == (0, [])
    assert "from the calibrations and transforms" in report.said("front/depth", "note")
    assert "has the calibration but is not a stream" in report.said("front/info", "note")
    assert report.said("front/color", "ok").endswith("messages/s")
    assert "nobody subscribes" in report.said("front/depth", "ok")
    assert report.said("r1", "ok") == "its gateway is on the bus and waits for nothing"


@pytest.mark.timeout(120)
async def test_topics_that_two_streams_are_made_of(ros: RosEnvironment, rig: FleetRig) -> None:
    """Of two connections of one node to one topic rospy ends the older one."""
    camera = await ros.script(CLOUD)
    await camera.until_output("publishers up")
    named = ("--discover", "--topics", "ros/static=/tf_static")
    await rig.gateway("r1", ros.master_uri, {}, *named)
    await rig.gateway_status("r1", lambda status: len(status.streams) == 3)
    report = await doctor(ros.master_uri, {}, rig.endpoint, *named)
    assert (report.code, report.problems) == (0, [])
    for stream in ("front/color", "front/points"):
        assert "messages/s, 0.05 MB each" in report.said(stream, "ok")
    assert "one latched message" in report.said("ros/static", "ok")


@pytest.mark.timeout(120)
async def test_what_makes_places_wrong(ros: RosEnvironment, rig: FleetRig) -> None:
    topics = ("/front/color/image_raw=color", "/front/color/camera_info=doubled", "/front/depth/image_raw=depth")
    cameras = [
        await ros.script(SCRIPT, "front", *topics, "/tf_static=base"),
        await ros.script(SCRIPT, "rear", "/front/color/image_raw=rear"),
    ]
    for camera in cameras:
        await camera.until_output("publishers up")
    await rig.gateway("r1", ros.master_uri, {})
    await rig.gateway_status("r1", lambda status: len(status.streams) == 4)
    report = await doctor(ros.master_uri, {}, rig.endpoint)
    assert report.code == 1
    mixed = report.said("front/color")
    assert mixed.startswith("it mixes several sensors: ")
    assert "/front sends frame 'color_lens'" in mixed
    assert "/rear sends frame 'rear_lens'" in mixed
    assert "its principal point (64, 48) is far off the centre of 64x48 pixels" in report.said("front/info")
    for frame in ("color_lens", "rear_lens", "depth_lens"):
        assert f"its frame '{frame}' is in no transform that came in 1.5 s" in report.said("front", "note")


@pytest.mark.timeout(120)
async def test_depth_that_is_not_aligned_and_a_gateway_too_many(ros: RosEnvironment, rig: FleetRig) -> None:
    infos = ("/front/color/camera_info=info", "/front/depth/camera_info=info")
    camera = await ros.script(SCRIPT, "camera", *infos, "/front/color/image_raw=color", "/front/depth/image_raw=depth")
    await camera.until_output("publishers up")
    for _ in range(2):
        await rig.gateway("r1", ros.master_uri, CAMERAS, *DEPTH)
    await rig.stream_status("r1", "front")
    report = await doctor(ros.master_uri, CAMERAS, rig.endpoint, *DEPTH)
    assert report.code == 1
    assert "not aligned with colour though their camera infos say so" in report.said("front/depth")
    assert "more than one gateway runs under this name" in report.said("r1")


@pytest.mark.timeout(120)
async def test_the_fleets_robots_are_listed(rig: FleetRig) -> None:
    async with RosMaster() as master:
        for robot in ("r1", "r2"):
            await rig.gateway(robot, master.uri, CAMERAS)
            await rig.gateway_status(robot)
        report = await fleet(rig.endpoint)
        assert (report.code, report.problems) == (0, [])
        for robot in ("r1", "r2"):
            assert report.said(robot, "ok").endswith(" offers 1 streams, of which 0 are wanted")
    await rig.gateway_status("r2", lambda status: status.waiting_for != "")
    report = await fleet(rig.endpoint)
    assert (report.code, report.problems) == (1, ["r1", "r2"])


@pytest.mark.timeout(120)
async def test_a_master_that_hangs_and_a_router_without_this_robot(ros: RosEnvironment, rig: FleetRig) -> None:
    os.kill(ros.master_pid, signal.SIGSTOP)
    async with rig.bus.announce("fleet/r2/alive"):
        report = await doctor(ros.master_uri, CAMERAS, rig.endpoint)
    assert report.code == 1
    assert "it accepts connections but does not answer" in report.said(ros.master_uri.rstrip("/"))
    assert report.said("r1") == "no gateway of this name is on the bus; there are those of r2"


@pytest.mark.timeout(120)
async def test_a_master_whose_name_does_not_resolve_and_ports_that_are_closed() -> None:
    router = f"tcp/127.0.0.1:{free_port()}"
    report = await doctor("http://no-such-robot.invalid:11311", CAMERAS, router)
    assert report.code == 1
    assert "no-such-robot.invalid does not resolve" in report.said("http://no-such-robot.invalid:11311")
    assert report.said(router) == "no router listens there"
