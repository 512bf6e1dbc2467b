"""A worker's side of a roll-out, with models that load at once; with real ones in tests/integration/services."""

import asyncio
import logging
from pathlib import Path

import pytest

from bus import QUEUE
from schemas.models import ModelUse
from schemas.status import WorkerStatus
from schemas.worker_keys import worker_status
from services.detector import rollout
from services.detector.model_cache import ModelCache
from services.detector.rollout import NONE_IN_FORCE, NOTHING_YET
from services.model_registry.client import use_model
from tests.services.detector.rollout.sites import BROKEN, Site, runs, use
from tests.services.model_registry.publishing import LONG
from tests.waiting import PATIENCE_S, receive, until


@pytest.fixture
def site(tmp_path: Path) -> Site:
    return Site(tmp_path)


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


async def test_a_model_that_is_superseded_while_it_loads_gives_way(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        site.may_load.clear()
        await use(bus, one)
        await until(lambda: site.loads == ["one"])
        await use(bus, two)
        site.may_load.set()
        await until(runs(following, two))
