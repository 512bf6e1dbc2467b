"""A model rolled out over real workers and back: real router, monitor process, commands, checkpoints and inference."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bus import QUEUE, QoS
from schemas import codec, keys, worker_keys
from schemas.detections import ClassList
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from schemas.models import PublishedModel
from schemas.status import WorkerStatus
from services.detector.process import run
from services.detector.runtime.offline import keep_offline
from services.detector.settings import DetectorSettings
from services.model_registry.client import publish_model
from services.model_registry.registry import digest_of
from services.toolbox.demo.children import Child, child
from services.toolbox.model import process as command
from services.toolbox.model.settings import ModelSettings
from tests.integration.fleet import PATIENCE_S, FleetRig, fleet_rig
from tests.schemas.frames import header

FRONTS = (CameraKey("r1", "front"), CameraKey("r2", "front"))
PERIOD_S = 0.05


@pytest.fixture(scope="module")
def weights(model_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    """Two models of the same classes, one without the class that workers rename, and half a file."""
    keep_offline(model_folder / "ultralytics", download=False)
    from tests.services.detector.runtime import built_models  # noqa: PLC0415 - it must be offline by then

    folder = tmp_path_factory.mktemp("weights")
    built: Any = built_models.build("yolo11n-seg.yaml")
    built.names = ["crate", "pallet", "forklift", "person"]
    files = {name: built_models.write(built, folder / f"{name}.pt", note=name) for name in ("site-1", "site-2")}
    built.names = ["tote", "pallet", "forklift", "person"]
    files["foreign"] = built_models.write(built, folder / "foreign.pt")
    files["half"] = folder / "half.pt"
    files["half"].write_bytes(files["site-1"].read_bytes()[:100_000])
    return files


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made, asyncio.TaskGroup() as group:
        filming = [group.create_task(film(made, key)) for key in FRONTS]
        yield made
        for each in filming:
            each.cancel()


async def film(rig: FleetRig, key: CameraKey) -> None:
    """Publish frames of a camera while they are wanted."""
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8).tobytes()
    encoding = codec.encoding(ImageFrame)
    async with (
        rig.bus.publisher(key.stream(Stream.COLOR), QoS.IMAGE, encoding=encoding) as color,
        rig.bus.announce(key.alive(Stream.COLOR)),
    ):
        seq = 0
        while True:
            if color.wanted:
                about = header(robot=key.robot, camera=key.camera, seq=seq)
                frame = ImageFrame(
                    header=about, height=48, width=64, encoding="rgb8", step=64 * 3, data=memoryview(pixels)
                )
                color.put(codec.encode(frame))
                seq += 1
            await asyncio.sleep(PERIOD_S)


@asynccontextmanager
async def monitor(rig: FleetRig, folder: Path) -> AsyncIterator[Child]:
    """Run a monitor with a registry, as a client of the rig's router."""
    options = ["--mode", "client", "--connect", rig.endpoint, "--no-web", "--history", "none"]
    async with child("monitor", ["monitor", *options, "--models", str(folder / "registry")], print) as started:
        yield started


@asynccontextmanager
async def worker(rig: FleetRig, folder: Path) -> AsyncIterator[None]:
    settings = DetectorSettings(
        model="fleet",
        connect=[rig.endpoint],
        worker="w1",
        cache=folder / "cache",
        runtime="torch",
        tracker="off",
        max_age_s=60,
        class_names=["crate=box"],
    )
    working = asyncio.create_task(run(settings))
    try:
        yield
    finally:
        working.cancel()
        await asyncio.wait([working])


async def model(rig: FleetRig, *arguments: str, **options: object) -> None:
    """Run `fleetsight model`, from the start again until the monitor is there."""
    fields = dict(zip(("task", "target"), arguments, strict=False))
    settings = ModelSettings.model_validate({"connect": [rig.endpoint], **fields, **options})
    async with asyncio.timeout(PATIENCE_S):
        while await command.run(settings) != 0:  # noqa: ASYNC110 - the monitor is another process
            await asyncio.sleep(0.1)


async def until_seen(rig: FleetRig, *labels: str) -> None:
    """Wait until the class lists of each camera are by the model whose name begins so."""
    newest: dict[str, str] = {}
    every = keys.every_stream(Stream.CLASSES)
    async with asyncio.timeout(PATIENCE_S), rig.bus.subscribe(every, QUEUE(1000), history=False) as lists:
        async for sample in lists:
            seen = codec.decode(ClassList, sample.payload, sample.encoding)
            assert "crate" not in {each.name for each in seen.classes}
            newest[seen.header.robot] = seen.model.partition("@")[0]
            if [newest.get(key.robot) for key in FRONTS] == list(labels):
                return


async def status(rig: FleetRig, so: Callable[[WorkerStatus], bool]) -> WorkerStatus:
    """Wait until the worker's status is such; return it."""
    key = worker_keys.worker_status("detector", "w1")
    async with asyncio.timeout(PATIENCE_S), rig.bus.subscribe(key, QUEUE(9), history=False) as statuses:
        async for sample in statuses:
            found = codec.decode(WorkerStatus, sample.payload, sample.encoding)
            if so(found):
                return found
    raise AssertionError("the bus was closed")


def says(text: str, found: WorkerStatus) -> bool:
    return text in str(found.remarks)


@asynccontextmanager
async def cameras_stay(rig: FleetRig) -> AsyncIterator[None]:
    """Check that the worker, once it serves all cameras, gives up none."""
    served: set[str] = set()
    lost: list[str] = []
    every = asyncio.Event()

    async def watch() -> None:
        async with rig.bus.watch(worker_keys.every_serves("detector")) as tokens:
            async for token in tokens:
                (served.add if token.alive else lost.append)(token.key)
                if len(served) == len(FRONTS):
                    every.set()

    watching = asyncio.create_task(watch())
    try:
        async with asyncio.timeout(PATIENCE_S):
            await every.wait()
        yield
        assert not lost
    finally:
        watching.cancel()


@pytest.mark.timeout(180)
async def test_a_model_goes_to_single_robots_then_to_all_and_back(
    rig: FleetRig, weights: Mapping[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async with monitor(rig, tmp_path), worker(rig, tmp_path):
        waiting = await status(rig, lambda _: True)
        assert (waiting.model, len(waiting.remarks)) == ("", 1)
        await model(rig, "publish", str(weights["site-1"]))
        await model(rig, "use", "site-1")
        await until_seen(rig, "site-1", "site-1")
        async with rig.subscribed(keys.every_stream(Stream.CLASSES)), cameras_stay(rig):
            await model(rig, "publish", str(weights["site-2"]))
            await model(rig, "use", "site-2", robots=["r2"])
            await until_seen(rig, "site-1", "site-2")
            both = await status(rig, lambda found: found.canary != "")
            assert (both.model[:7], both.canary[:7], both.remarks) == ("site-1@", "site-2@", [])
            await model(rig, "use", digest_of(weights["site-2"])[:8])
            await until_seen(rig, "site-2", "site-2")
            await model(rig, "back")
            await until_seen(rig, "site-1", "site-1")
        capsys.readouterr()
        await model(rig, "list", json=True)
        listed = json.loads(capsys.readouterr().out)
    assert [each["name"] for each in listed["models"]] == ["site-1", "site-2"]
    assert [listed["in_force"], listed["before"]] == [digest_of(weights["site-1"]), ""]
    assert [each["worker"] for each in listed["workers"]] == ["w1"]
    assert listed["workers"][0]["model"].startswith("site-1@")


@pytest.mark.timeout(180)
async def test_models_that_cannot_be_used_are_refused_and_the_old_one_goes_on(
    rig: FleetRig, weights: Mapping[str, Path], tmp_path: Path
) -> None:
    async with monitor(rig, tmp_path), worker(rig, tmp_path), rig.subscribed(keys.every_stream(Stream.CLASSES)):
        for name in ("site-1", "foreign"):
            await model(rig, "publish", str(weights[name]))
        file = weights["half"]  # which the command would refuse
        half = PublishedModel(digest=digest_of(file), name="half", size=100_000)
        await publish_model(rig.bus, half, file, lambda _: None)
        await model(rig, "use", "site-1")
        await until_seen(rig, "site-1", "site-1")
        async with cameras_stay(rig):
            for name, why in (
                ("half", "not a model that can be used"),
                ("foreign", "--class-names with it: no class is called 'crate'"),
            ):
                await model(rig, "use", name)
                refused = f"{name}@{digest_of(weights[name])[:12]} is refused"
                found = await status(rig, partial(says, refused))
                assert found.remarks[0].startswith(f"{refused}, {found.model} goes on: {why}")
                await until_seen(rig, "site-1", "site-1")


@pytest.mark.timeout(180)
async def test_a_monitor_and_a_worker_that_start_again_know_what_is_in_force(
    rig: FleetRig, weights: Mapping[str, Path], tmp_path: Path
) -> None:
    async with worker(rig, tmp_path):
        async with monitor(rig, tmp_path):
            for name in ("site-1", "site-2"):
                await model(rig, "publish", str(weights[name]))
            await model(rig, "use", "site-1")
            await until_seen(rig, "site-1", "site-1")
        await until_seen(rig, "site-1", "site-1")
    async with worker(rig, tmp_path):  # without a monitor
        await until_seen(rig, "site-1", "site-1")
        async with monitor(rig, tmp_path):
            await model(rig, "use", "site-2")
            await until_seen(rig, "site-2", "site-2")
            await model(rig, "back")
            await until_seen(rig, "site-1", "site-1")
