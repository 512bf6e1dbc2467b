"""When a worker is there, and how its end is told, on the real bus."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from bus import QUEUE, Bus, BusSettings, QoS, RefusedError, open_bus
from schemas import codec, worker_keys
from schemas.image import ImageFrame
from schemas.keys import Stream
from schemas.models import ModelUse
from schemas.status import WorkerStatus
from services.detector.model import ModelError
from services.detector.process import FAILED, run, work
from services.detector.refusals import ENDED
from services.detector.runtime.loading import SuccessiveLoading
from services.detector.settings import DetectorSettings
from services.model_registry.client import publish_model, use_model
from services.model_registry.serving import serving_models
from services.toolbox.demo.children import free_ports
from tests.services.detector.support.fakes import FakeModel
from tests.services.detector.test_requests import png
from tests.services.detector.test_worker import FRONT, frame
from tests.services.model_registry.publishing import model_of
from tests.waiting import PATIENCE_S, receive, until


@asynccontextmanager
async def fleet() -> AsyncIterator[tuple[Bus, str]]:
    """Give a bus, and the endpoint that it is found at."""
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    async with open_bus(BusSettings(mode="router", listen=[endpoint])) as bus:
        yield bus, endpoint


def settings(endpoint: str, **fields: object) -> DetectorSettings:
    return DetectorSettings.model_validate({"connect": [endpoint], "tracker": "off", **fields})


async def test_a_worker_whose_model_cannot_be_loaded_is_never_there(tmp_path: Path) -> None:
    (tmp_path / "bad.pt").write_bytes(b"no weights")
    async with fleet() as (bus, endpoint), bus.watch("workers/**") as watch:
        with pytest.raises(ModelError, match="not a model that can be used"):
            await run(settings(endpoint, model=str(tmp_path / "bad.pt")))
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(anext(watch), 0.2)


async def test_a_model_that_works_no_longer_is_a_failure_with_one_line_and_no_wrong_setting(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with (
        fleet() as (bus, endpoint),
        bus.publisher(FRONT.stream(Stream.COLOR), QoS.IMAGE, encoding=codec.encoding(ImageFrame)) as camera,
        bus.announce(FRONT.alive(Stream.COLOR)),
        bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)),
        asyncio.TaskGroup() as group,
    ):
        working = group.create_task(work(settings(endpoint), FakeModel(broken=True)))
        await until(lambda: camera.wanted)
        camera.put(codec.encode(frame(0)))
        assert await working == FAILED
    assert [each.getMessage() for each in caplog.records if each.levelno >= logging.ERROR] == ["no memory"]


async def test_a_model_that_works_no_longer_ends_a_worker_without_cameras_too(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with fleet() as (bus, endpoint), bus.watch(worker_keys.every_worker_alive("detector")) as watch:
        working = asyncio.create_task(work(settings(endpoint, worker="w1"), FakeModel(broken=True)))
        assert (await anext(watch)).alive
        with pytest.raises(RefusedError, match="busy: this worker is shutting down: no memory"):
            await bus.request(worker_keys.infer("w1"), png(), timeout_s=PATIENCE_S)
        assert await working == FAILED
        assert not (await anext(watch)).alive
    assert [each.getMessage() for each in caplog.records if each.levelno >= logging.ERROR] == ["no memory"]


async def test_a_fleet_model_that_fails_at_its_first_image_ends_one_worker_and_is_refused_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SuccessiveLoading, "load", lambda *_: FakeModel(broken=True))
    file, model = tmp_path / "bad.pt", model_of(b"bad", "bad")
    file.write_bytes(b"bad")
    async with (
        fleet() as (bus, endpoint),
        serving_models(bus, tmp_path / "registry"),
        bus.publisher(FRONT.stream(Stream.COLOR), QoS.IMAGE, encoding=codec.encoding(ImageFrame)) as camera,
        bus.announce(FRONT.alive(Stream.COLOR)),
        bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)),
        bus.subscribe(worker_keys.worker_status("detector", "w2"), QUEUE(9)) as statuses,
        asyncio.TaskGroup() as group,
    ):
        await publish_model(bus, model, file, lambda _: None)
        await use_model(bus, ModelUse(digest=model.digest), PATIENCE_S)
        fields = {"model": "fleet", "cache": tmp_path / "cache"}
        working = group.create_task(run(settings(endpoint, worker="w1", **fields)))
        await until(lambda: camera.wanted)
        camera.put(codec.encode(frame(0)))
        assert await working == FAILED
        working = group.create_task(run(settings(endpoint, worker="w2", **fields)))
        refused = f"{model.label} is refused: {ENDED}"
        while refused not in (await receive(statuses, WorkerStatus)).remarks:
            pass
        working.cancel()
