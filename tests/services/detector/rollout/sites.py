"""A site whose models load at once: a monitor with a registry, and workers that follow it."""

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from bus import Bus
from bus.fake import FakeNetwork
from schemas.models import ModelUse, PublishedModel
from services.detector.model import ModelError
from services.detector.model_cache import ModelCache
from services.detector.rollout import Rollout
from services.model_registry.client import publish_model, use_model
from services.model_registry.serving import serving_models
from services.worker.thread import worker_thread
from tests.services.detector.support.fakes import FakeModel
from tests.services.model_registry.publishing import model_of
from tests.waiting import PATIENCE_S

BROKEN = b"broken"


class SiteModel(FakeModel):
    """Knows whether it was closed."""

    closed = False

    def close(self) -> None:
        self.closed = True


class Site:
    """A monitor that can be started again, and workers with a cache."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.network = FakeNetwork()
        self.loads: list[str] = []
        self.ready: dict[str, SiteModel] = {}
        self.out_of_memory = 0
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
        if self.out_of_memory:
            self.out_of_memory -= 1
            raise MemoryError("no memory for it")
        model = SiteModel()
        model.name = weights.name
        self.ready[self.loads[-1]] = model
        return model


async def use(bus: Bus, model: PublishedModel, *robots: str) -> None:
    await use_model(bus, ModelUse(digest=model.digest, robots=list(robots)), PATIENCE_S)


def runs(following: Rollout, model: PublishedModel, canary: PublishedModel | None = None) -> Callable[[], bool]:
    def condition() -> bool:
        found = following.model
        if found is None or found.in_force.digest != model.digest:
            return False
        return (found.canary.digest if found.canary else None) == (canary.digest if canary else None)

    return condition
