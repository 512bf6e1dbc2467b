"""A new model beside the one in force: real rospy camera, gateway, workers and monitor, and models that differ."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest

from bus import QUEUE
from schemas import worker_keys
from schemas.alerts import Alert
from schemas.detections import Box, ClassList, Detection
from schemas.keys import CameraKey, Stream
from schemas.status import BEYOND_USE, CameraLoad, WorkerStatus
from services.detector.frame_counts import ABOVE_OPINION_RATE
from services.detector.model import DetectedObjects, Outcome, Request
from services.detector.process import work
from services.detector.settings import DetectorSettings
from tests.integration.fleet import PATIENCE_S, FleetRig, fleet_rig, receive
from tests.integration.monitor.watching import inventory
from tests.integration.peers.ros import RosEnvironment
from tests.integration.to_bus.test_first_light import CAMERAS, camera, raw
from tests.services.detector.support.fakes import FakeModel

FRONT = CameraKey("r1", "front")
CLASSES_TOPIC = "/ultralytics/detection/classes"
HZ = 10
SLOW_S = 0.4
RULES = "rules: [{name: another model, when: disagree, for_s: 1}]"


class CountingModel(FakeModel):
    """Finds so many boxes in every image, in its own time."""

    def __init__(self, name: str, boxes: int, call_s: float) -> None:
        super().__init__(segments=False)
        self.name = name
        self._boxes = [Detection(name="box", score=0.75, box=Box(0, 0, 9, 9))] * boxes
        self._call_s = call_s

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`."""
        await asyncio.sleep(self._call_s)
        return [DetectedObjects(self._boxes) for _ in batch]


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


@asynccontextmanager
async def working(rig: FleetRig, worker: str, model: CountingModel, *, opinion: bool = False) -> AsyncIterator[None]:
    settings = DetectorSettings(connect=[rig.endpoint], worker=worker, opinion=opinion, tracker="off")
    running = asyncio.create_task(work(settings, model))
    try:
        yield
    finally:
        running.cancel()
        await asyncio.wait([running])


async def load_of(rig: FleetRig, service: str, worker: str, inferred: int) -> CameraLoad:
    """Wait until a worker has looked at so many frames of the front camera; return what became of them all."""
    async with asyncio.timeout(PATIENCE_S), rig.subscribed(worker_keys.worker_status(service, worker)) as statuses:
        while True:
            for load in (await receive(statuses, WorkerStatus)).cameras:
                if load.inferred >= inferred:
                    return load


@pytest.mark.timeout(180)
async def test_a_model_that_counts_otherwise_is_alerted_of_and_nobody_else_hears_it(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path
) -> None:
    rules = tmp_path / "rules.yaml"
    rules.write_text(RULES, encoding="utf-8")
    await camera(ros, CAMERAS["front"], [raw(tmp_path, "grey.rgb", np.full((48, 64, 3), 90, np.uint8))], HZ)
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    await rig.start("monitor", "--mode", "client", "--no-web", "--history", "none", "--rules", str(rules))
    echo = await ros.rostopic("echo", CLASSES_TOPIC)
    async with (
        rig.bus.subscribe("fleet/r1/alerts", QUEUE(9)) as alerts,
        rig.bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9999)) as lists,
        working(rig, "new", CountingModel("best.pt", 2, SLOW_S), opinion=True),
    ):
        await load_of(rig, "opinion", "new", inferred=3)
        assert lists.counts.received == 0, "an opinion alone is no class list"
        assert (await inventory(rig)).sightings == []
        async with working(rig, "old", CountingModel("best.pt", 1, 0.01)):
            alert = await receive(alerts, Alert)
            assert (alert.rule, alert.name, alert.text) == (
                "another model",
                "box",
                "two models count 1 and 2 box in view of r1/front",
            )
            (sighting,) = (await inventory(rig)).sightings
            assert (sighting.count, sighting.worker) == (1, "old")
            await the_other_one_harms_nobody(rig)
        taken = [await receive(lists, ClassList) for _ in range(lists.counts.received)]
    assert {(seen.worker, seen.classes[0].count) for seen in taken} == {("old", 1)}
    echoed = {line for line in echo.output.split("\n")[:-1] if line.startswith("data:")}
    assert echoed == {"data: \"['box']\""}


async def the_other_one_harms_nobody(rig: FleetRig) -> None:
    """The one in force gets every frame; the other one, slow as it is, looks at some of them and goes on."""
    before = await rig.stream_status("r1", "front", lambda status: status.wanted)
    in_force = await load_of(rig, "detector", "old", inferred=5 * HZ)
    assert sum(in_force.dropped.values()) < HZ
    other = await load_of(rig, "opinion", "new", inferred=12)
    assert other.dropped[ABOVE_OPINION_RATE] > other.inferred
    after = await rig.stream_status("r1", "front", lambda status: status.wanted)
    assert after.forwarded >= before.forwarded + HZ
    assert after.dropped.get(BEYOND_USE, 0) == before.dropped.get(BEYOND_USE, 0)
