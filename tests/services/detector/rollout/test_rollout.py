"""A worker's side of a roll-out, with models that load at once; with real ones in tests/integration/services."""

import asyncio
import logging
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from bus import QUEUE, Bus
from bus.fake import FakeNetwork
from schemas.models import ModelUse, PublishedModel
from schemas.status import WorkerStatus
from schemas.worker_keys import worker_status
from services.detector import rollout
from services.detector.model import ModelError
from services.detector.model_cache import ModelCache
from services.detector.rollout import NONE_IN_FORCE, NOTHING_YET, Rollout
from services.model_registry.client import fetch_model, publish_model, use_model
from services.model_registry.serving import serving_models
from services.worker.thread import worker_thread
from tests.services.detector.support.fakes import FakeModel
from tests.services.model_registry.publishing import LONG, model_of
from tests.waiting import PATIENCE_S, receive, until

BROKEN = b"broken"


class Site:
    """A monitor that can be started again, and workers with a cache."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.network = FakeNetwork()
        self.loads: list[str] = []
        self.may_load = threading.Event()
        self.may_load.set()

    @asynccontextmanager
    async def monitor(self) -> AsyncIterator[Bus]:
        async with self.network.open_bus() as bus, serving_models(bus, self.folder / "registry"):
            yield bus

    @asynccontextmanager
    async def worker(self) -> AsyncIterator[Rollout]:
        async with self.network.open_bus() as bus, asyncio.TaskGroup() as group:
            with worker_thread("loading") as thread:
                following = Rollout(bus, ModelCache(self.folder / "cache"), self._load, thread)
                running = group.create_task(following.run())
                try:
                    yield following
                finally:
                    running.cancel()

    async def publish(self, bus: Bus, content: bytes, name: str) -> PublishedModel:
        file, model = self.folder / name, model_of(content, name)
        file.write_bytes(content)
        await publish_model(bus, model, file, lambda _: None)
        return model

    def _load(self, weights: Path) -> FakeModel:
        self.loads.append(weights.name.partition("@")[0])
        assert self.may_load.wait(PATIENCE_S)
        if weights.read_bytes() == BROKEN:
            raise ModelError(f"--model {weights}: not a model that can be used")
        model = FakeModel()
        model.name = weights.name
        return model


@pytest.fixture
def site(tmp_path: Path) -> Site:
    return Site(tmp_path)


async def use(bus: Bus, model: PublishedModel, *robots: str) -> None:
    await use_model(bus, ModelUse(digest=model.digest, robots=list(robots)), PATIENCE_S)


def runs(following: Rollout, model: PublishedModel, canary: PublishedModel | None = None) -> Callable[[], bool]:
    def condition() -> bool:
        found = following.model
        if found is None or found.in_force.digest != model.digest:
            return False
        return (found.canary.digest if found.canary else None) == (canary.digest if canary else None)

    return condition


async def test_without_a_monitor_and_a_cache_it_waits_and_says_so(site: Site) -> None:
    async with (
        site.worker() as following,
        site.network.open_bus() as other,
        other.subscribe(worker_status("detector", "w1"), QUEUE(9)) as statuses,
    ):
        waiting = asyncio.create_task(following.first("detector", "w1"))
        status = await receive(statuses, WorkerStatus)
        assert (status.model, status.remarks) == ("", [NOTHING_YET])
        async with site.monitor() as bus:
            while (await receive(statuses, WorkerStatus)).remarks != [NONE_IN_FORCE]:
                pass
            model = await site.publish(bus, LONG, "site")
            await use(bus, model)
            assert (await waiting).name == f"{model.label}.pt"


async def test_it_follows_what_is_in_force_and_back_needs_nothing_new(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        await use(bus, one)
        await until(runs(following, one))
        await use(bus, two)
        await until(runs(following, two))
        await use_model(bus, ModelUse(digest=""), PATIENCE_S)
        await until(runs(following, one))
        assert site.loads == ["one", "two", "one"]
        assert following.notes == ()


async def test_a_canary_is_loaded_beside_and_not_again_when_it_is_used_everywhere(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        await use(bus, one)
        await use(bus, two, "r1", "r2")
        await until(runs(following, one, two))
        assert following.model is not None
        assert following.model.robots == {"r1", "r2"}
        await use(bus, two, "r2")
        await until(lambda: following.model is not None and following.model.robots == {"r2"})
        await use(bus, two)
        await until(runs(following, two))
        assert site.loads == ["one", "two"]


async def test_one_that_cannot_be_loaded_is_refused_once_and_the_old_one_goes_on(
    site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, bad = await site.publish(bus, b"one", "one"), await site.publish(bus, BROKEN, "bad")
        await use(bus, one)
        await until(runs(following, one))
        await use(bus, bad, "r1")
        await until(lambda: "refused" in str(following.notes))
        assert runs(following, one)()
        await use(bus, bad)
        await until(lambda: "refused" in str(following.notes))
        assert following.model is not None
        (remark,) = following.model.remarks
        assert remark == f"{bad.label} is refused, {one.label}.pt goes on: not a model that can be used"
        await use_model(bus, ModelUse(digest=""), PATIENCE_S)
        await until(lambda: following.notes == ())
        assert site.loads == ["one", "bad"]
    assert [each.getMessage() for each in caplog.records if each.levelno == logging.ERROR] == [remark]


async def test_a_worker_starts_with_what_it_ran_last_without_a_monitor(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        await use(bus, one)
        await use(bus, two, "r1")
        await until(runs(following, one, two))
        last = site.folder / "cache" / "models" / "last.json"
        await until(lambda: last.exists() and two.digest in last.read_text().partition("canary")[2])
    async with site.worker() as following:
        await until(runs(following, one, two))
        async with site.monitor() as bus:
            await use(bus, two)
            await until(runs(following, two))


async def test_a_cache_that_was_damaged_is_no_start(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        model = await site.publish(bus, b"one", "one")
        await use(bus, model)
        await until(runs(following, model))
        await until((site.folder / "cache" / "models" / "last.json").exists)
    ModelCache(site.folder / "cache").path(model).write_bytes(b"eno")
    async with site.worker() as following:
        await until(lambda: not ModelCache(site.folder / "cache").path(model).exists())
        assert following.model is None
        async with site.monitor():
            await until(runs(following, model))
    assert site.loads == ["one", "one"]


async def test_it_asks_again_until_the_file_can_be_had(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rollout, "RETRY_S", 0.05)
    async with site.monitor() as bus, site.worker() as following:
        model = await site.publish(bus, b"one", "one")
        file = site.folder / "registry" / f"{model.digest}.pt"
        file.write_bytes(b"eno")
        await use(bus, model)
        await until(lambda: "cannot be fetched, and is asked for again: what came of" in str(following.notes))
        file.write_bytes(b"one")
        await until(runs(following, model))
        assert following.notes == ()


async def test_a_canary_that_cannot_be_had_keeps_nobody_from_what_is_in_force(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rollout, "RETRY_S", 0.05)
    async with site.monitor() as bus:
        one, two, three = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two", b"three")]
        (site.folder / "registry" / f"{three.digest}.pt").write_bytes(b"eerht")
        await use(bus, one)
        async with site.worker() as following:
            await until(runs(following, one))
            await use(bus, three, "r1")
            await until(lambda: "three@" in str(following.notes))
            await use(bus, two)
            await use(bus, three, "r1")
            await until(runs(following, two))
            await until(lambda: "three@" in str(following.notes))
    async with site.worker() as following:
        await until(runs(following, two))


async def test_a_file_that_is_no_longer_wanted_is_not_fetched_to_its_end(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    async def fetch_slowly(bus: Bus, model: PublishedModel, file: Path, progress: Callable[[int], None]) -> None:
        asked.append(model.name)
        if model.name == "one":
            while True:
                progress(1)
                await asyncio.sleep(0)
        await fetch_model(bus, model, file, progress)

    monkeypatch.setattr(rollout, "fetch_model", fetch_slowly)
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        await use(bus, one)
        await until(lambda: asked)
        await site.publish(bus, b"three", "three")  # which changes nothing about it
        await use(bus, two)
        await until(runs(following, two))
    assert asked == ["one", "two"]


async def test_a_model_that_is_superseded_while_it_loads_gives_way(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        site.may_load.clear()
        await use(bus, one)
        await until(lambda: site.loads == ["one"])
        await use(bus, two)
        site.may_load.set()
        await until(runs(following, two))
