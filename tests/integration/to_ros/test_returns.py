"""Results of the fleet on a robot's real ROS 1 graph: rostopic and rosbag are the ones who want them."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager
from pathlib import Path

import pytest

from bus import Publisher, QoS
from gateway.ros1.master import MasterClient
from gateway.ros1.messages import message_type
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.to_ros.outputs import STRING
from gateway.to_ros.stream import MALFORMED
from schemas import codec
from schemas.detections import ClassList
from schemas.keys import CameraKey, Stream
from tests.gateway.to_ros.lists import class_list
from tests.integration.detecting import results
from tests.integration.fleet import PATIENCE_S, FleetRig, fleet_rig
from tests.integration.peers.ros import RosEnvironment, RosProcess
from tests.integration.peers.rospy_scripts import BAG_READER, BAG_TOPICS
from tests.integration.to_bus.test_first_light import camera, raw
from tests.services.detector.support.views import NEAR_VIEWS, near_view
from tests.waiting import until

CAMERAS = {"front": "/front/color/image_raw", "rear-2": "/rear/color/image_raw"}
FRONT, REAR = (CameraKey("r1", name) for name in CAMERAS)
RECORD = ("/usr/bin/rosbag", "record", "-a")
FRONT_TOPIC, REAR_TOPIC = "/ultralytics/detection/classes", "/ultralytics/rear_2/detection/classes"


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def record_all(ros: RosEnvironment, rig: FleetRig, bag: Path) -> RosProcess:
    """Record every topic; returns once the recorder is connected to both cameras' results."""
    recording = await ros.run(*RECORD, f"--output-name={bag}")
    for name in CAMERAS:
        await rig.return_status("r1", name, lambda status: status.subscribers > 0)
    return recording


async def topics_of_recorder(ros: RosEnvironment, among: str) -> set[str]:
    """Return what rosbag subscribes to, once one of the topics is among it."""
    async with XmlRpcClient() as client, asyncio.timeout(PATIENCE_S):
        master = MasterClient(client, uri=ros.master_uri, caller_id="/test")
        while True:
            subscribers = (await master.get_system_state()).subscribers
            found = {topic for topic, nodes in subscribers.items() if any("/record_" in node for node in nodes)}
            if among in found:
                return found
            await asyncio.sleep(0.1)


def detecting(rig: FleetRig, key: CameraKey, *counts: tuple[str, int]) -> AbstractAsyncContextManager[Publisher]:
    """Publish class lists, as a detector does."""
    return results(rig.bus, key, Stream.CLASSES, lambda seq: class_list(*counts, seq=seq, camera=key.camera))


@pytest.mark.timeout(120)
async def test_rostopic_shows_and_echoes_each_cameras_results_and_makes_the_demand(
    ros: RosEnvironment, rig: FleetRig
) -> None:
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    async with (
        detecting(rig, FRONT, ("box", 2), ("it's", 1)) as front,
        detecting(rig, REAR, ("forklift", 1)) as rear,
    ):
        await rig.return_status("r1", "front", lambda status: not status.wanted and status.subscribers == 0)
        info = await (await ros.rostopic("info", FRONT_TOPIC)).finished()
        assert "Type: std_msgs/String" in info
        assert "/fleetsight_gateway_r1_" in info
        assert "Subscribers: None" in info
        assert (front.counts.put, rear.counts.put) == (0, 0)
        echo = await ros.rostopic("echo", FRONT_TOPIC)
        await echo.until_output("""['box', 'box', \\"it's\\"]""")
        await rig.return_status("r1", "front", lambda status: status.wanted and status.published > 0)
        assert not rear.wanted
        assert "['forklift']" in await (await ros.rostopic("echo", "-n", "1", REAR_TOPIC)).finished()
        await echo.end()
        await until(lambda: not front.wanted and not rear.wanted, "the end of the listeners ends the demand")
        await rig.return_status("r1", "front", lambda status: not status.wanted and status.subscribers == 0)


@pytest.mark.timeout(120)
async def test_rosbag_records_results_with_their_definition(ros: RosEnvironment, rig: FleetRig, tmp_path: Path) -> None:
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    bag = tmp_path / "results.bag"
    async with detecting(rig, FRONT, ("pallet", 2)):
        recording = await ros.run("/usr/bin/rosbag", "record", "--limit=3", f"--output-name={bag}", FRONT_TOPIC)
        await recording.finished()
    read = await (await ros.script(BAG_READER, str(bag))).finished()
    kind = message_type(STRING)
    found = [line for line in read.splitlines() if line]
    assert len(found) == 3
    for line in found:
        assert line.startswith(
            f"read {FRONT_TOPIC} ['pallet', 'pallet'] {STRING} {kind.md5sum} /fleetsight_gateway_r1_"
        )
        assert line.endswith(f" {kind.definition.strip()}")


@pytest.mark.timeout(120)
async def test_a_recorder_of_everything_wants_every_result_and_it_is_said_once(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    async with detecting(rig, FRONT, ("box", 1)) as front, detecting(rig, REAR, ("box", 1)) as rear:
        bag = await record_all(ros, rig, tmp_path / "all.bag")
        await rig.return_status("r1", "rear-2", lambda status: status.wanted)
        await until(lambda: front.wanted and rear.wanted, "all class lists are wanted")
        await until(lambda: "subscribes to all 13 results" in caplog.text, "the log says so")
        await bag.end()
        await until(lambda: not front.wanted and not rear.wanted, "none is wanted any more")
        await ros.rostopic("pub", "-r", "5", "/mode", STRING, "hello")
        await ros.run(*RECORD, f"--output-name={tmp_path / 'others.bag'}", "-x", ".*/(ultralytics|fleetsight)/.*")
        assert FRONT_TOPIC not in await topics_of_recorder(ros, "/mode")
        assert not front.wanted
    (said,) = (line for line in caplog.messages if "subscribes to all" in line)
    assert "`rosbag record -a -x '.*/(ultralytics|fleetsight)/.*'` leaves results out" in said
    assert "--passive-subscribers '/record_.*'" in said


@pytest.mark.timeout(120)
async def test_a_passive_recorder_makes_nothing_wanted_and_records_what_others_want(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path
) -> None:
    await rig.gateway("r1", ros.master_uri, CAMERAS, "--passive-subscribers", "/record_.*")
    async with detecting(rig, FRONT, ("pallet", 2)) as front, detecting(rig, REAR, ("box", 1)) as rear:
        bag = await record_all(ros, rig, tmp_path / "all.bag")
        assert not (await rig.return_status("r1", "front")).wanted
        echo = await ros.rostopic("echo", FRONT_TOPIC)
        await echo.until_output("'pallet'")
        assert front.wanted
        assert not rear.wanted
        await echo.end()
        await until(lambda: not front.wanted, "the end of the listener ends the demand")
        await bag.end()
    topics = (await (await ros.script(BAG_TOPICS, str(tmp_path / "all.bag"))).finished()).split()
    assert FRONT_TOPIC in topics
    assert REAR_TOPIC not in topics


@pytest.mark.timeout(120)
async def test_malformed_results_are_counted_and_harm_nobody(ros: RosEnvironment, rig: FleetRig) -> None:
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    key = FRONT.stream(Stream.CLASSES)
    async with (
        detecting(rig, FRONT, ("box", 1)),
        rig.bus.publisher(key, QoS.MESSAGE, encoding=codec.encoding(ClassList)) as stranger,
    ):
        echo = await ros.rostopic("echo", FRONT_TOPIC)
        await echo.until_output("['box']")
        stranger.put(b"garbage")
        malformed = await rig.return_status("r1", "front", lambda status: MALFORMED in status.dropped)
        stranger.put(codec.encode(class_list(("forklift", 1), camera="rear-2")))
        await rig.return_status(
            "r1",
            "front",
            lambda status: status.dropped.get(MALFORMED) == 2 and status.published > malformed.published,
        )
        assert "forklift" not in echo.output


@pytest.mark.timeout(120)
async def test_a_gateway_told_to_return_nothing_publishes_nothing(ros: RosEnvironment, rig: FleetRig) -> None:
    await rig.gateway("r1", ros.master_uri, CAMERAS, "--no-results")
    await rig.stream_status("r1", "front")
    assert "/ultralytics" not in await (await ros.rostopic("list")).finished()


@pytest.mark.timeout(180)
async def test_an_echo_on_the_robot_makes_a_detector_infer_and_its_end_stops_it(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path
) -> None:
    view = next(view for view in NEAR_VIEWS if "box" in view.classes)
    await camera(ros, CAMERAS["front"], [raw(tmp_path, "box.rgb", near_view(view))])
    await rig.gateway("r1", ros.master_uri, {"front": CAMERAS["front"]})
    await rig.start("detector")
    assert (await rig.stream_status("r1", "front")).received == 0
    echo = await ros.rostopic("echo", FRONT_TOPIC)
    await echo.until_output("'box'")
    await rig.stream_status("r1", "front", lambda status: status.wanted and status.publishers == 1)
    await echo.end()
    await rig.stream_status("r1", "front", lambda status: not status.wanted and status.publishers == 0)
    await rig.return_status("r1", "front", lambda status: not status.wanted and status.published > 0)
