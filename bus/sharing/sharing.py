"""Serves the cameras that belong to this worker, for as long as they do."""

import asyncio
import logging
from asyncio import Task, TaskGroup
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AsyncExitStack, suppress
from typing import Final

from bus.api import Bus, Presence, Watch
from bus.demand import SharedDemand
from bus.sharing.camera_assignment import TAKE_OVER_S
from bus.sharing.own_cameras import OwnCameras
from bus.sharing.watchdog import CHECK_S, StallDetector, unanswered
from schemas import keys, worker_keys
from schemas.errors import SchemaError
from schemas.keys import CameraKey, Stream
from schemas.status import MAX_STREAMS
from schemas.worker_keys import Serves, WorkerAlive

SETTLE_S: Final = 0.03
"""Time for which changes of workers and cameras are gathered before the plan is updated."""

JOIN_S: Final = 0.2
"""Time for which a new worker watches the others before it joins."""

LEAVE_S: Final = 0.8
"""Longest time for which a leaving worker continues until others have taken over."""

UNWANTED_S: Final = 0.2
"""A new camera whose results nobody has wanted for this long counts as taken over."""

Serve = Callable[[CameraKey, Callable[[], None]], Awaitable[None]]
"""Serves a camera until cancelled; calls its second argument once results come, or nobody wants any."""

log = logging.getLogger(__name__)


class Sharing:
    """One worker's part in the work sharing of its service.

    tokens: what it says of itself, see `SharingSettings.tokens`. stream: the one whose presence says that there is a
    camera to look after. serve: does it, one call at a time for each camera. pending: by what the next answer to its
    work's calls is known, see `unanswered`. most: how many cameras at a time. leaves: called when it leaves, before the
    others take over.
    """

    def __init__(
        self,
        bus: Bus,
        tokens: Sequence[WorkerAlive],
        stream: Stream,
        serve: Serve,
        *,
        pending: Callable[[], object] = lambda: None,
        most: int = MAX_STREAMS,
        join_s: float = JOIN_S,
        leaves: Callable[[], None] = lambda: None,
    ) -> None:
        self._bus = bus
        self._tokens = tokens
        self._service, self._worker = tokens[0].service, tokens[0].worker
        self._stream = stream
        self._serve = serve
        self._pending = pending
        self._most = most
        self._join_s = join_s
        self._leaves = leaves
        self._own = OwnCameras(self._worker)
        self._joined = False
        self._stalled, self._answers = asyncio.Event(), asyncio.Event()
        self._answers.set()
        self._news = asyncio.Event()
        self._tasks: dict[CameraKey, Task[None]] = {}
        self._ending: dict[CameraKey, Task[None]] = {}

    async def run(self) -> None:
        """Share the work until cancelled; then hand it over to the others, within LEAVE_S."""
        async with (
            self._bus.watch(worker_keys.every_worker_alive(self._service)) as workers,
            self._bus.watch(worker_keys.every_serves(self._service)) as taken,
            self._bus.watch(keys.every_stream_alive(self._stream)) as cameras,
            TaskGroup() as group,
        ):
            group.create_task(self._note(workers, self._note_worker))
            group.create_task(self._note(taken, self._note_taken))
            group.create_task(self._note(cameras, self._note_camera))
            watching = group.create_task(self._watch_calls())
            await asyncio.sleep(self._join_s)
            try:
                await self._take_part(group)
            finally:
                watching.cancel()
                await self._hand_over(group)

    async def _watch_calls(self) -> None:
        """Show which cameras are served, or none while a call does not answer: then other workers take them."""
        detector = StallDetector()
        async for checks in unanswered(self._pending):
            stalled = detector.look(checks)
            if stalled and not self._stalled.is_set():
                log.info("a call has not answered for %g s: other workers may take the cameras", checks * CHECK_S)
            (self._stalled.set if stalled else self._stalled.clear)()
            (self._answers.clear if stalled else self._answers.set)()

    async def _take_part(self, group: TaskGroup) -> None:
        async with AsyncExitStack() as stack:
            self._joined = True
            for token in self._tokens:
                await stack.enter_async_context(self._bus.announce(str(token)))
                self._own.worker(token, alive=True)
            while True:
                self._follow_plan(group)
                await self._news_or_time()

    async def _hand_over(self, group: TaskGroup) -> None:
        self._leaves()
        for token in self._tokens:
            self._own.worker(token, alive=False)
        with suppress(TimeoutError):
            async with asyncio.timeout(LEAVE_S):
                self._follow_plan(group)
                while self._own.handing_over:
                    await self._news_or_time()
                    self._follow_plan(group)
        ending = [*self._tasks.values(), *self._ending.values()]
        for task in self._tasks.values():
            task.cancel()
        if ending:  # the group would cancel them again, while they publish their last messages
            await asyncio.wait(ending)

    async def _news_or_time(self) -> None:
        with suppress(TimeoutError):
            async with asyncio.timeout_at(self._own.next_s):
                await self._news.wait()
                await asyncio.sleep(SETTLE_S)
        self._news.clear()

    def _follow_plan(self, group: TaskGroup) -> None:
        planned = self._own.plan(asyncio.get_running_loop().time(), self._most)
        fewer, more = self._tasks.keys() - planned, planned - self._tasks.keys()
        for camera in fewer:
            self._end(camera)
        for camera in more:
            self._tasks[camera] = group.create_task(self._look_after(camera, self._ending.get(camera)))
        if fewer or more:
            log.info("serving %d cameras: %d added, %d removed", len(planned), len(more), len(fewer))
        if len(planned) == self._most and more:
            log.warning("further cameras are left out: this worker serves %d, its limit", self._most)

    def _end(self, camera: CameraKey) -> None:
        task = self._tasks.pop(camera)
        task.cancel()
        if camera not in self._ending:  # otherwise it waits for the previous task and has begun nothing
            self._ending[camera] = task
            task.add_done_callback(lambda _: self._ending.pop(camera))

    async def _look_after(self, camera: CameraKey, before: Task[None] | None) -> None:
        """Serve a camera, once its previous task has ended."""
        if before is not None:
            await asyncio.wait([before])
        took_over = asyncio.Event()
        async with TaskGroup() as group:
            saying = group.create_task(self._say_taken(camera, took_over))
            await self._serve(camera, took_over.set)
            saying.cancel()

    async def _say_taken(self, camera: CameraKey, took_over: asyncio.Event) -> None:
        with suppress(TimeoutError):
            async with asyncio.timeout(TAKE_OVER_S):
                await took_over.wait()
        while True:
            await self._answers.wait()
            async with self._bus.announce(str(Serves(self._service, self._worker, camera))):
                await self._stalled.wait()

    async def _note(self, watch: Watch, take: Callable[[Presence], bool]) -> None:
        async for presence in watch:
            try:
                if take(presence):
                    self._news.set()
            except SchemaError as error:
                log.warning("%s: left out: %s", presence.key[:200], error)

    def _note_worker(self, presence: Presence) -> bool:
        token = worker_keys.parse_worker_alive(presence.key)
        if token.worker != self._worker:
            return self._own.worker(token, alive=presence.alive)
        if presence.alive and not (self._joined and token in self._tokens):
            log.warning(
                "another worker is also called %s: both will process the same cameras; give each its own --worker",
                token.worker,
            )
        return False

    def _note_taken(self, presence: Presence) -> bool:
        return self._own.taken(worker_keys.parse_serves(presence.key), alive=presence.alive)

    def _note_camera(self, presence: Presence) -> bool:
        return self._own.camera(keys.parse_stream(presence.key).camera, alive=presence.alive)


async def say_unwanted(demand: SharedDemand, took_over: Callable[[], None]) -> None:
    """Report a camera as taken over when nobody wants its results: none will come that could report it."""
    await asyncio.sleep(UNWANTED_S)
    await demand.until(wanted=False)
    took_over()
