"""Depth of a real ROS 1 camera and objects found in its colour become distances, on Zenoh and back on ROS."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import numpy as np
import pytest

from bus import QUEUE, Publisher, QoS
from schemas import codec
from schemas.detections import Box, Detection, Detections
from schemas.distances import Distances
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from services.toolbox.demo.children import free_ports
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import PEERS, RosEnvironment
from tests.schemas.masks import coco_mask

FRONT = CameraKey("r1", "front")
SCENE = (PEERS / "rospy_depth_scene.py").read_text(encoding="utf-8")
MASK = np.zeros((240, 320), np.bool_)
MASK[78:162, 118:202] = True  # two pixels more than the box on each side
BOX = Detection(name="box", score=0.9, box=Box(118, 78, 202, 162), mask=coco_mask(MASK))


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


@asynccontextmanager
async def detecting(rig: FleetRig) -> AsyncIterator[Publisher]:
    """Find a box in every colour image while somebody wants to know, as a detector does."""
    key = FRONT.stream(Stream.DETECTIONS)

    async def detect(publisher: Publisher) -> None:
        async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(4), history=False) as frames:
            async for sample in frames:
                frame = codec.decode(ImageFrame, sample.payload, sample.encoding)
                publisher.put(
                    codec.encode(
                        Detections(header=frame.header, height=240, width=320, objects=[BOX], model="m", worker="w")
                    )
                )

    async with rig.bus.publisher(key, QoS.RESULT, encoding=codec.encoding(Detections)) as publisher:
        task = asyncio.create_task(detect(publisher))
        try:
            yield publisher
        finally:
            task.cancel()
            await asyncio.wait([task])


@pytest.mark.timeout(120)
async def test_an_echo_on_the_robot_shows_distances_and_zenoh_has_places(ros: RosEnvironment, rig: FleetRig) -> None:
    camera = await ros.script(SCENE)
    await camera.until_output("scene up")
    port = free_ports(1)
    await rig.gateway("r1", ros.master_uri, {}, "--listen", f"tcp/127.0.0.1:{port}")
    await rig.at(port).start("distance", "--robots", "r1")
    async with detecting(rig) as detections:
        await rig.return_status("r1", "front", lambda status: not status.wanted, stream="distances")
        assert not detections.wanted
        echo = await ros.rostopic("echo", "/ultralytics/detection/distance")
        await echo.until_output("['box: 2.31m']")
        async with rig.subscribed(FRONT.stream(Stream.DISTANCES)) as distances:
            while True:
                seen = await receive(distances, Distances)
                measured = seen.objects[0].measured
                if measured is not None and measured.places[2].at is not None:
                    break
        await echo.end()
    places = {place.frame_id: place.at for place in measured.places}
    assert places["camera_color_optical_frame"] == pytest.approx((0, 0, 2.31), abs=0.01)
    assert places["base_link"] == pytest.approx((1, 0, 2.31), abs=0.01)
    assert places["map"] == pytest.approx((2, 0, 2.31), abs=0.01)
    assert measured.axial_m == pytest.approx(2.31, abs=1e-6)
    assert measured.mean_m > 2.35
