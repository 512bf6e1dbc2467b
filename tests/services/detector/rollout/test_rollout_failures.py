"""A roll-out where models fail, cannot be fetched, or are taken back while they are on their way."""

import asyncio
import logging
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bus import QoS, RequestError
from schemas import codec
from schemas.keys import CameraKey
from schemas.models import ModelRegistry, ModelUse, PublishedModel
from schemas.worker_keys import ModelKey
from services.detector import refusals, rollout
from services.detector.model import DetectedObjects, Request
from services.detector.model_cache import ModelCache
from services.detector.rollout import NOT_IN_CACHE, Rollout
from services.model_registry.client import use_model
from tests.services.detector.rollout.sites import BROKEN, Site, runs, use
from tests.services.detector.support.requests import frame_of
from tests.services.model_registry.publishing import LONG
from tests.waiting import PATIENCE_S, until


@pytest.fixture
def site(tmp_path: Path) -> Site:
    return Site(tmp_path)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rollout, "LEAST_WAIT_S", 0.01)
    monkeypatch.setattr(rollout, "RETRY_S", 0.05)
    for name in ("RETRY_S", "BLIND_RETRY_S"):
        monkeypatch.setattr(refusals, name, (0.05, 0.1))


async def look(following: Rollout, robot: str) -> str:
    """Return which model looks at an image of a robot."""
    assert following.model is not None
    asked = Request(CameraKey(robot, "front"), frame_of(np.zeros((2, 2, 3), np.uint8)), masks=False)
    (found,) = await following.model.infer([asked])
    assert isinstance(found, DetectedObjects)
    return found.model.partition("@")[0]


def last_of(site: Site) -> ModelRegistry | None:
    return ModelCache(site.folder / "cache").recall()


def lose(site: Site, model: PublishedModel) -> None:
    """Damage a published file, so that no worker can fetch it."""
    (site.folder / "registry" / f"{model.digest}.pt").write_bytes(b"x" * model.size)


@pytest.mark.usefixtures("quick")
async def test_a_model_that_failed_for_a_while_is_tried_again_with_none_and_beside_another(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        for model in (one, two):
            site.out_of_memory = 2
            await use(bus, model)
            await until(runs(following, model))
            assert following.notes == ()
    assert site.loads == ["one"] * 3 + ["two"] * 3


async def test_a_refused_model_is_tried_at_once_when_it_is_put_in_force_again(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        await use(bus, one)
        await until(runs(following, one))
        site.out_of_memory = 1
        await use(bus, two)
        await until(lambda: f"{two.label} is refused" in str(following.notes))
        await use(bus, one)
        await until(lambda: following.notes == ())
        await use(bus, two)
        await until(runs(following, two))
    assert site.loads == ["one", "two", "two"]


async def test_fetches_that_fail_wait_longer_each_time_but_for_those_that_came_further(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    failures: list[int] = []

    def wait_s(tries: int, first_s: float, most_s: float) -> float:
        assert first_s < most_s
        failures.append(tries)
        return 0

    monkeypatch.setattr(rollout, "growing_wait_s", wait_s)
    monkeypatch.setattr(rollout, "LEAST_WAIT_S", 0.01)
    async with site.monitor() as bus, site.worker() as following:
        lost, long = await site.publish(bus, b"lost", "lost"), await site.publish(bus, LONG, "long")
        lose(site, lost)
        await use(bus, lost)
        await until(lambda: failures[:3] == [1, 2, 3])
        cut = [False, True, True, False, True]

        async def fetch(*given: Any) -> None:
            _, model, file, progress = given
            if model.digest == lost.digest or cut:
                if model.digest == long.digest and not cut.pop(0):
                    progress(1)
                raise RequestError("no answer")
            await asyncio.to_thread(file.write_bytes, LONG)

        monkeypatch.setattr(rollout, "fetch_rest", fetch)
        failures.clear()
        await use(bus, long)
        await until(runs(following, long))
    assert failures[-5:] == [1, 2, 3, 1, 2]


async def test_a_canary_that_fails_is_refused_and_the_worker_goes_on(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        await use(bus, one)
        await use(bus, two, "r1")
        await until(runs(following, one, two))
        site.ready["two"].broken = True
        assert await look(following, "r1") == "one"
        await until(lambda: f"{two.label} is refused, {one.label}.pt goes on: no memory" in following.notes)
        assert runs(following, one)()


async def test_a_new_model_that_fails_at_its_first_image_gives_way_to_the_one_before(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        await use(bus, one)
        await until(runs(following, one))
        assert await look(following, "r1") == "one"
        await use(bus, two)
        await until(runs(following, two))
        site.ready["two"].broken = True
        assert await look(following, "r1") == "one"
        await until(lambda: f"{two.label} is refused, {one.label}.pt goes on: no memory" in following.notes)
        await until(lambda: (last := last_of(site)) is not None and last.in_force == one.digest)
        assert (runs(following, one)(), site.ready["two"].closed, site.loads) == (True, True, ["one", "two"])


async def test_a_model_that_ended_the_worker_is_not_what_the_next_start_begins_with(site: Site) -> None:
    async with site.monitor() as bus:
        async with site.worker() as following:
            one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
            await use(bus, one)
            await until(runs(following, one))
            await use(bus, two)
            await until(runs(following, two))
            following.leave_marked()
        async with site.worker() as following:
            await until(runs(following, one))
            await until(lambda: f"{two.label} is refused, {one.label}.pt goes on: {refusals.ENDED}" in following.notes)
        assert site.loads == ["one", "two", "one"]


async def test_a_model_that_is_taken_back_while_it_loads_never_looks_at_anything(
    site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        await use(bus, one)
        await until(runs(following, one))
        site.may_load.clear()
        await use(bus, two)
        await until(lambda: site.loads == ["one", "two"])
        await use_model(bus, ModelUse(digest=""), PATIENCE_S)
        await until(lambda: following._wanted is not None and following._wanted.in_force == one.digest)
        site.may_load.set()
        await until(lambda: "two" in site.ready and site.ready["two"].closed)
        assert runs(following, one)()
    assert site.loads == ["one", "two"]
    assert "takes over" not in caplog.text


async def test_a_model_loads_once_though_the_registry_says_something_new_meanwhile(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        site.may_load.clear()
        await use(bus, one)
        await until(lambda: site.loads == ["one"])
        await use(bus, two, "r1")
        await until(lambda: following._wanted is not None and following._wanted.canary == two.digest)
        site.may_load.set()
        await until(runs(following, one, two))
    assert site.loads == ["one", "two"]


@pytest.mark.usefixtures("quick")
async def test_nothing_waits_for_a_canary_that_cannot_be_fetched(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two, lost = [await site.publish(bus, each, each.decode()) for each in (b"one", b"two", b"lost")]
        lose(site, lost)
        await use(bus, one)
        await use(bus, lost, "r1")
        await until(lambda: f"{lost.label} cannot be fetched" in str(following.notes))
        await until(lambda: (last := last_of(site)) is not None and last.in_force == one.digest)
        await use(bus, two)
        await until(runs(following, two))


@pytest.mark.usefixtures("quick")
async def test_a_canary_ends_though_the_new_model_in_force_cannot_be_fetched(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two, lost = [await site.publish(bus, each, each.decode()) for each in (b"one", b"two", b"lost")]
        lose(site, lost)
        await use(bus, one)
        await use(bus, two, "r1")
        await until(runs(following, one, two))
        await use(bus, lost)
        await until(lambda: f"{lost.label} cannot be fetched" in str(following.notes))
        assert runs(following, one)()


@pytest.mark.usefixtures("quick")
async def test_a_start_runs_the_model_in_the_cache_until_the_new_one_has_come(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with site.monitor() as bus:
        async with site.worker() as following:
            one, lost = [await site.publish(bus, each, each.decode()) for each in (b"one", b"lost")]
            await use(bus, one)
            await until(runs(following, one))
        lose(site, lost)
        await use(bus, lost)
        last, may_recall = last_of(site), threading.Event()
        monkeypatch.setattr(ModelCache, "recall", lambda _: last if may_recall.wait(PATIENCE_S) else None)
        async with site.worker() as following:
            await until(lambda: following._wanted is not None)  # the registry is heard before the cache is read
            may_recall.set()
            await until(runs(following, one))
            await until(lambda: f"{lost.label} cannot be fetched" in str(following.notes))


async def test_a_worker_that_never_ran_a_model_takes_the_one_before_a_refused_one(site: Site) -> None:
    async with site.monitor() as bus:
        one, bad = await site.publish(bus, b"one", "one"), await site.publish(bus, BROKEN, "bad")
        await use(bus, one)
        await use(bus, bad)
        async with site.worker() as following:
            await until(runs(following, one))
            refused = f"{bad.label} is refused, {one.label}.pt goes on: not a model that can be used"
            await until(lambda: refused in following.notes)


async def test_notes_say_that_an_old_model_goes_on_and_which_canary_is_lacking(site: Site) -> None:
    async with site.monitor() as bus, site.worker() as following:
        one, two = [await site.publish(bus, content, content.decode()) for content in (b"one", b"two")]
        await use(bus, one)
        await use(bus, two, "r1")
        await until(lambda: (last := last_of(site)) is not None and last.canary == two.digest)
    ModelCache(site.folder / "cache").path(two).unlink()
    async with site.worker() as following, site.network.open_bus() as bus:
        await until(runs(following, one))
        await until(lambda: following.notes == (f"{two.label} {NOT_IN_CACHE}",))
        async with bus.publisher(ModelKey.REGISTRY, QoS.STATUS, encoding=codec.encoding(ModelRegistry)) as registry:
            registry.put(codec.encode(ModelRegistry(models=[one])))
            goes_on = f"no model is in force, {one.label}.pt goes on: `fleetsight model use NAME` puts one in force"
            await until(lambda: following.notes == (goes_on,))
