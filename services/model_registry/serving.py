"""Serves the model registry on the bus, unless another process does; then it stands by."""

import asyncio
import logging
import os
import secrets
import socket
import time
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Executor
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from bus import LATEST, Bus, RequestError, Subscription
from schemas import codec
from schemas.errors import SchemaError
from schemas.models import ModelRegistry
from schemas.printing import printable
from schemas.worker_keys import ModelKey
from services.model_registry.answering import answering
from services.model_registry.client import ask_registry
from services.model_registry.folder import FolderInUseError, RegistryError
from services.model_registry.registry import Registry
from services.worker.thread import worker_thread

log = logging.getLogger(__name__)

AGAIN_S: Final = 5.0
"""Seconds between two messages with an unchanged state, and between two tries to serve."""

ASK_S: Final = 5.0
"""Seconds that another registry has to answer at the start."""

GONE_S: Final = 30.0
"""Seconds without a message after which another registry is gone: its monitor may be started again meanwhile."""

CLOSE_S: Final = 1.0
"""Seconds that a stopping monitor waits for what the registry does just then."""

MAX_OTHERS: Final = 16
"""Other registries that are noticed at once."""

T = TypeVar("T")

Holder = tuple[int, str]
"""A process that serves a registry: since when, and its name. The first one goes on where there are several."""


@asynccontextmanager
async def serving_models(bus: Bus, folder: Path) -> "AsyncIterator[ModelService]":
    """Serve the registry in a folder while the context lasts, and no other process does.

    Raises:
        RegistryError: the folder cannot be used.
    """
    with worker_thread("models") as thread:
        service = ModelService(bus, folder, thread)
        async with bus.subscribe(ModelKey.REGISTRY, LATEST, few=True) as states:
            tasks = []
            try:
                await service.begin()
                tasks = [asyncio.create_task(service.listen(states)), asyncio.create_task(service.run())]
                yield service
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
                await service.end()


class ModelService:
    """The registry of a folder, which serves or stands by. thread: runs what the registry does."""

    def __init__(self, bus: Bus, folder: Path, thread: Executor) -> None:
        self._bus = bus
        self._folder = folder
        self._thread = thread
        self._name = f"{socket.gethostname()[:64]}, process {os.getpid()}, {secrets.token_hex(3)}"
        self._since_ns = 0
        self._registry: Registry | None = None
        self._tell: Callable[[], object] = lambda: None
        self._serving = AsyncExitStack()
        self._others: dict[Holder, float] = {}
        self._heard = asyncio.Event()
        self._problem = ""

    @property
    def state(self) -> ModelRegistry | None:
        """The state that is served; None while it stands by."""
        return None if self._registry is None else self._registry.state

    def problems(self) -> list[str]:
        """Return why it does not serve, which others do, and which models were lost, in lines."""
        lost = () if self._registry is None else self._registry.problems
        return [*([self._problem] if self._problem else []), *lost]

    async def begin(self) -> None:
        """Serve, if no other process does.

        Raises:
            RegistryError: the folder cannot be used.
        """
        with suppress(RequestError, SchemaError):
            self._hear(await ask_registry(self._bus, ASK_S))
        with suppress(FolderInUseError):
            await self._keep_on()

    async def run(self) -> None:
        """Publish the state again and again, stand by while another process serves, and serve when it is gone."""
        while True:
            with suppress(TimeoutError):
                async with asyncio.timeout(AGAIN_S):
                    await self._heard.wait()
            self._heard.clear()
            try:
                await self._keep_on()
            except RegistryError as error:
                self._say(str(error))
            except Exception as error:
                log.exception("the model registry failed")
                self._say(f"the model registry failed, and is tried again: {error!r}")

    async def listen(self, states: Subscription) -> None:
        """Take notice of other registries."""
        async for sample in states:
            with suppress(SchemaError):
                self._hear(codec.decode(ModelRegistry, sample.payload, sample.encoding))

    async def end(self) -> None:
        """Serve no longer."""
        self._registry = None
        await self._serving.aclose()

    def _hear(self, state: ModelRegistry) -> None:
        holder = (state.since_ns, state.registry)
        known = holder in self._others
        if state.registry == self._name or (not known and len(self._others) >= MAX_OTHERS):
            return
        self._others[holder] = time.monotonic()
        if not known:
            self._heard.set()

    async def _keep_on(self) -> None:
        """Serve or stand by, as others do. Raises RegistryError."""
        now_s = time.monotonic()
        self._others = {holder: heard_s for holder, heard_s in self._others.items() if now_s - heard_s < GONE_S}
        first = min(self._others, default=None)
        if first is not None and (self._registry is None or first < (self._since_ns, self._name)):
            self._say(
                f"--models {self._folder} is not served: {_named(first)} serves models already; give one monitor alone"
                f" --models. This one serves its own folder once the other has been gone for {GONE_S:.0f} s"
            )
            await self.end()
            return
        if self._registry is None:
            await self._serve()
        else:
            await self._in_thread(partial(self._registry.end_idle_uploads, time.monotonic()))
        self._tell()
        self._say("" if first is None else f"{_named(first)} serves models too: give one monitor --models")

    async def _serve(self) -> None:
        async with AsyncExitStack() as stack:
            try:
                registry = await self._in_thread(lambda: Registry(self._folder))
            except FolderInUseError as error:
                self._say(str(error))
                raise
            stack.push_async_callback(self._close, registry)
            self._since_ns = time.time_ns()
            told = {"registry": self._name, "since_ns": self._since_ns}
            self._tell = await stack.enter_async_context(
                answering(self._bus, registry, self._thread, lambda: msgspec.structs.replace(registry.state, **told))
            )
            checking = asyncio.create_task(self._check_files(registry))
            stack.callback(checking.cancel)
            self._serving = stack.pop_all()
            self._registry = registry

    async def _close(self, registry: Registry) -> None:
        await asyncio.wait([self._in_thread(registry.close)], timeout=CLOSE_S)

    async def _check_files(self, registry: Registry) -> None:
        """Withdraw models whose files are damaged: first those in use, beside all other work."""
        state = registry.state
        in_use = (state.in_force, state.canary, state.before)
        for model in sorted(state.models, key=lambda each: each.digest not in in_use):
            if why := await asyncio.to_thread(registry.why_damaged, model):
                await self._in_thread(partial(registry.withdraw, model.digest, why))
                self._tell()

    def _in_thread(self, call: Callable[[], T]) -> "asyncio.Future[T]":
        return asyncio.get_running_loop().run_in_executor(self._thread, call)

    def _say(self, problem: str) -> None:
        """Set the problem; log a new one."""
        if problem and problem != self._problem:
            log.error("%s", problem)
        self._problem = problem


def _named(holder: Holder) -> str:
    return printable(holder[1]) or "another monitor"
