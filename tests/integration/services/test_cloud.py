"""Debian's rospy publishes a coloured cloud and hears its objects again, by way of gateway, bus and cloud worker."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bus import QoS
from schemas import codec
from schemas.detections import Box, Detection, Detections
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import PEERS, RosEnvironment, RosProcess, require_ros
from tests.schemas.masks import coco_mask
from tests.services.toolbox.clouds.reading import read_ply
from tests.waiting import until

CLOUD = (PEERS / "rospy_cloud.py").read_text(encoding="utf-8")
LISTENER = (PEERS / "rospy_returns.py").read_text(encoding="utf-8")
TOPIC = "/ultralytics/segmentation/points"
FRONT = CameraKey("r1", "front")
INNER = 18 * 18  # of 20 x 20 points, less the mask's edge


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


def seen_red(frame: ImageFrame) -> Detections:
    """Find what is red, as a detector would."""
    pixels = np.frombuffer(frame.data, np.uint8).reshape(frame.height, frame.step // 3, 3)
    mask = coco_mask((pixels == (255, 0, 0)).all(axis=2))
    box = Detection(name="box", score=0.9, box=Box(20, 10, 40, 30), mask=mask, label=2)
    return Detections(
        header=frame.header, height=frame.height, width=frame.width, objects=[box], model="red", worker="test"
    )


@asynccontextmanager
async def detecting(rig: FleetRig) -> AsyncIterator[None]:
    """Find what is red in every picture for as long as the context lasts."""

    async def detect() -> None:
        encoding = codec.encoding(Detections)
        async with (
            rig.bus.publisher(FRONT.stream(Stream.DETECTIONS), QoS.RESULT, encoding=encoding) as detections,
            rig.subscribed(FRONT.stream(Stream.COLOR)) as frames,
        ):
            while True:
                detections.put(codec.encode(seen_red(await receive(frames, ImageFrame))))

    async with asyncio.TaskGroup() as group:
        working = group.create_task(detect())
        yield
        working.cancel()


def heard(listener: RosProcess) -> list[dict[str, Any]]:
    return [json.loads(line) for line in listener.output.splitlines() if line.startswith("{")]


@pytest.mark.timeout(120)
async def test_objects_of_a_coloured_cloud_come_back_to_ros_and_into_files(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path
) -> None:
    require_ros("geometry_msgs", "tf2_msgs")
    await rig.gateway("r1", ros.master_uri, {}, "--compression", "raw")
    await rig.start("cloud")
    await ros.script(CLOUD)
    async with detecting(rig):
        listener = await ros.script(LISTENER, f"{TOPIC}=PointCloud2")
        await until(lambda: any(each["width"] for each in heard(listener)), "objects are heard on ROS")
        wanted = ("--do", "save", "--robot", "r1", "--camera", "front", "--folder", str(tmp_path))
        await rig.start("clouds", *wanted)
        await until(lambda: list(tmp_path.glob("*.pcd")), "files are written")
    sent = next(each for each in heard(listener) if each["width"])
    assert (sent["frame_id"], sent["height"], sent["width"]) == ("front_optical_frame", 1, INNER)
    assert {tuple(point[2:]) for point in sent["points"]} == {(2.0, 2, 0)}
    assert max(abs(point[0]) for point in sent["points"]) == pytest.approx(8.5 / 50 * 2)
    check_file(tmp_path)


def check_file(folder: Path) -> None:
    """Check that the points of the box are saved, with colour, class and object."""
    (ply,) = folder.glob("*.ply")
    _, vertices = read_ply(ply.read_bytes())
    assert {vertex[2:] for vertex in vertices} == {(2.0, 255, 0, 0, 2, 0)}
    assert len(vertices) == INNER
