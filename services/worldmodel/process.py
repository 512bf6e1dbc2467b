"""The process of the world model: serves the sites that no other worker serves, and stands by for the others."""

import asyncio
import logging
import time
from asyncio import Event, Task, TaskGroup
from contextlib import suppress
from pathlib import Path
from typing import Final

from bus import LATEST, Bus, RequestError, Watch, open_bus
from bus.reporting import VERSION, report
from bus.sharing.camera_assignment import CameraAssignment
from schemas import codec, worker_keys
from schemas.errors import SchemaError
from schemas.status import WorkerStatus
from schemas.worker_keys import Serves, WorkerAlive, WorldStream, parse_worker_alive, world_key
from schemas.world import WorldRequest
from services import service_manager
from services.whole_file import write_whole
from services.worldmodel.settings import WorldSettings
from services.worldmodel.site import Site, site_key

SERVICE: Final = "worldmodel"
JOIN_S: Final = 0.5
"""Time for which a new worker watches the others before it takes a site."""

ASK_S: Final = 1.0
AGAIN_S: Final = 2.0
"""Time after which it is asked again whether a site is served whose worker has shown no token."""

SETTLE_S: Final = 0.3
"""Time for which a site must be without a worker before another one takes it."""

log = logging.getLogger(__name__)


class WorldWorker:
    """One worker. A site stays with the worker that has it for as long as that is there: its state is large."""

    def __init__(self, bus: Bus, settings: WorldSettings, *, join_s: float = JOIN_S) -> None:
        self._bus = bus
        self._settings = settings
        self._join_s = join_s
        self._token = parse_worker_alive(str(WorkerAlive(SERVICE, settings.worker)))
        self._assignment = CameraAssignment(settings.worker)
        self._assignment.worker(self._token, alive=True)
        self._news = Event()
        self._states: dict[str, bytes] = {}
        self._tasks: dict[str, Task[None]] = {}

    async def run(self) -> None:
        """Work until cancelled."""
        async with (
            self._bus.watch(worker_keys.every_worker_alive(SERVICE)) as workers,
            self._bus.watch(worker_keys.every_serves(SERVICE)) as serving,
            TaskGroup() as group,
        ):
            group.create_task(self._watch_workers(workers))
            group.create_task(self._watch_served(serving))
            for site in self._settings.robots_of:
                group.create_task(self._stand_by(site))
            await asyncio.sleep(self._join_s)
            async with self._bus.announce(str(self._token)):
                status = worker_keys.worker_status(SERVICE, self._settings.worker)
                group.create_task(report(self._bus, status, WorkerStatus, self._status))
                group.create_task(service_manager.say_serving(lambda: self._bus.link_problem))
                await asyncio.sleep(SETTLE_S)
                await self._take_sites(group)

    async def _take_sites(self, group: TaskGroup) -> None:
        while True:
            self._news.clear()
            served = False
            for site in self._settings.robots_of:
                if site in self._tasks or not self._is_mine(site):
                    continue
                if await self._is_served(site):
                    served = True
                elif self._is_mine(site):  # still: tokens may have come meanwhile
                    self._tasks[site] = group.create_task(self._serve(site))
            soon_s = asyncio.get_running_loop().time() + AGAIN_S if served else None
            with suppress(TimeoutError):
                async with asyncio.timeout_at(soon_s or self._assignment.next_s):
                    await self._news.wait()
            await asyncio.sleep(SETTLE_S)

    def _is_mine(self, site: str) -> bool:
        key = site_key(site)
        if self._assignment.took(key) - {self._settings.worker}:
            self._assignment.forget(key)  # another worker serves it, so its owner by hash does not count as idle
            return False
        return self._assignment.owner(key, asyncio.get_running_loop().time()) == self._settings.worker

    async def _is_served(self, site: str) -> bool:
        """Whether somebody serves a site whose token has not come yet, as on a slow link to a worker that just began.

        One that has got the site's state stood by: it does not ask, as it takes over.
        """
        if self._states.get(site):
            return False
        nothing = codec.encode(WorldRequest(seen_within_s=0.0, least_existence=1.0))
        key, encoding = world_key(site, WorldStream.OBJECTS), codec.encoding(WorldRequest)
        try:
            await self._bus.request(key, nothing, encoding=encoding, timeout_s=ASK_S)
        except RequestError:
            return False
        return True

    async def _serve(self, site: str) -> None:
        # announce first: loading takes long, and no other worker may take the site meanwhile
        async with self._bus.announce(str(Serves(SERVICE, self._settings.worker, site_key(site)))):
            await self._keep_site(site)

    async def _keep_site(self, site: str) -> None:
        file = self._file(site)
        state = self._states.get(site, b"")
        if not state and file is not None:
            state = await asyncio.to_thread(_read, file)
        served = Site(self._bus, self._settings, site, state)
        log.info("site %s: serving it, with %d objects", site, int(served.model.objects.confirmed.sum()))
        pending = asyncio.Queue[bytes](1)

        def keep(state: bytes) -> None:
            self._states[site] = state
            if file is not None and not pending.full():
                pending.put_nowait(state)

        try:
            async with TaskGroup() as group:
                if file is not None:
                    group.create_task(_write_all(file, pending))
                await served.run(keep)
        finally:
            if file is not None:
                _write(file, served.state())

    def _file(self, site: str) -> Path | None:
        return None if self._settings.state is None else self._settings.state / f"{site}.world"

    async def _stand_by(self, site: str) -> None:
        """Keep the newest state of a site that another worker serves."""
        async with self._bus.subscribe(world_key(site, WorldStream.STATE), LATEST) as states:
            async for sample in states:
                if site not in self._tasks:
                    self._states[site] = sample.payload

    async def _watch_workers(self, watch: Watch) -> None:
        async for presence in watch:
            try:
                worker = parse_worker_alive(presence.key)
            except SchemaError:
                continue
            if worker != self._token:
                self._assignment.worker(worker, alive=presence.alive)
                self._news.set()

    async def _watch_served(self, watch: Watch) -> None:
        async for presence in watch:
            try:
                token = worker_keys.parse_serves(presence.key)
            except SchemaError:
                continue
            self._assignment.taken(token, alive=presence.alive)
            self._news.set()

    def _status(self) -> WorkerStatus:
        return WorkerStatus(
            service=SERVICE,
            worker=self._settings.worker,
            model="",
            sent_ns=time.time_ns(),
            cameras=[],
            version=VERSION,
        )


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except FileNotFoundError:
        return b""
    except OSError as error:
        log.warning("%s: cannot be read (%s); starting with an empty site", file, error.strerror)
        return b""


def _write(file: Path, state: bytes) -> None:
    try:
        write_whole(file, state, durable=True)
    except OSError as error:
        log.warning("%s: not written: %s", file, error.strerror)


async def _write_all(file: Path, states: "asyncio.Queue[bytes]") -> None:
    """Write states one after the other until cancelled; one that is being written is written whole first."""
    while True:
        writing = asyncio.ensure_future(asyncio.to_thread(_write, file, await states.get()))
        try:
            await asyncio.shield(writing)
        finally:
            await writing


async def run(settings: WorldSettings) -> None:
    """Run a worker until cancelled."""
    async with open_bus(settings) as bus:
        log.info("world model's worker %s is ready", settings.worker)
        await WorldWorker(bus, settings).run()
