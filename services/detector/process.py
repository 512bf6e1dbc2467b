"""The detector process: loads the model, joins the bus and works."""

import asyncio
import logging
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, Final

from bus import Bus, open_bus
from bus.sharing import Pace
from bus.sharing.rate_request import RateRequest
from bus.sharing.sharing import JOIN_S, say_unwanted
from bus.sharing.work_counts import Tallies
from schemas.header import MAX_LABEL
from schemas.keys import CameraKey
from schemas.status import MAX_CLASSES
from schemas.worker_keys import WorkerAlive
from services.detector.camera import CameraOutputs, feed, serving
from services.detector.fleet_model import FleetModel
from services.detector.frame_counts import ABOVE_OPINION_RATE, REPLACED, FrameCounts
from services.detector.frame_queue import FrameQueue
from services.detector.inference import Inference
from services.detector.model import Model, ModelError
from services.detector.model_cache import ModelCache, usable_cache
from services.detector.regions import Regions
from services.detector.requests import FINISH_S, Leaving, answering
from services.detector.rollout import Rollout
from services.detector.runtime.loading import SuccessiveLoading, load_all, tracking
from services.detector.settings import SHIPPED_EXPORT, SHIPPED_MODEL, DetectorSettings
from services.detector.tracking.tracks import Tracking
from services.detector.tuning import deviations
from services.detector.worker_role import DETECTOR, OPINION, WorkerRole
from services.model_registry.registry import digest_of
from services.worker.thread import worker_thread
from services.worker.worker import Worker

PACE_PERIOD_S: Final = 0.25

OVERLAY_THREADS: Final = 2
"""Threads that draw the overlays of all cameras: each draws its newest frame in its turn."""


class DetectorWorker:
    """Serves the cameras assigned to this worker.

    tokens: what it says of itself, under the service of its role. tracking, max_age_s, regions: see `Inference`.
    leaving: hears when it leaves.
    """

    def __init__(
        self,
        bus: Bus,
        model: Model,
        tokens: Sequence[WorkerAlive],
        *,
        role: WorkerRole = DETECTOR,
        tracking: Tracking | None = None,
        max_age_s: float | None = None,
        join_s: float = JOIN_S,
        leaving: Leaving | None = None,
        regions: Regions | None = None,
    ) -> None:
        self._bus = bus
        self._model = model
        self._configured = model.tuning
        self._role = role
        self._name = tokens[0].worker
        self._frame_queue = FrameQueue()
        self._cameras: dict[CameraKey, CameraOutputs] = {}
        unread = REPLACED if role.most_hz is None else ABOVE_OPINION_RATE  # a newer one is as good for an opinion
        self._tallies = Tallies(partial(FrameCounts, unread=unread))
        self._asked: dict[CameraKey, RateRequest] = {}
        self._took_over: dict[CameraKey, Callable[[], None]] = {}
        self._leaving = leaving or Leaving()
        self._overlay_threads = ThreadPoolExecutor(OVERLAY_THREADS, thread_name_prefix="overlays")
        self._pace = Pace()
        self._inference = Inference(
            model,
            self._name,
            self._frame_queue,
            tracking=tracking,
            cameras=self._cameras,
            tallies=self._tallies.kept,
            max_age_s=max_age_s,
            keeps_up=lambda: self._pace.limit_hz is None,
            on_result=self._has_result,
            regions=regions or Regions(()),
        )
        self._worker = Worker(
            bus,
            tokens,
            self._tallies,
            self._serve,
            details=self._details,
            pending=self._inference.pending,
            join_s=join_s,
            leaves=self._leaving.begin,
        )

    async def run(self) -> None:
        """Work until cancelled; then hand over, publish the results in flight, and end.

        Raises:
            ModelError: the model is of no more use.
        """
        try:
            await self._worker.run(self._keep_pace(), self._inference.run())
        finally:
            self._overlay_threads.shutdown(wait=False, cancel_futures=True)

    async def _serve(self, key: CameraKey, tally: FrameCounts, took_over: Callable[[], None]) -> None:
        asked = self._asked[key] = RateRequest()
        asked.ask(self._role.most_hz)
        self._took_over[key] = took_over
        segments, overlay_threads = self._model.segments, self._overlay_threads
        try:
            async with (
                serving(
                    self._bus, key, tally, role=self._role, segments=segments, overlay_threads=overlay_threads
                ) as camera,
                asyncio.TaskGroup() as group,
            ):
                self._cameras[key] = camera
                group.create_task(say_unwanted(camera.demand, took_over))
                try:
                    await feed(self._bus, camera, self._frame_queue, asked, worker=self._name, role=self._role)
                finally:
                    await self._finish(camera)
        finally:
            del self._asked[key], self._took_over[key]
            self._cameras.pop(key, None)

    async def _finish(self, camera: CameraOutputs) -> None:
        """Wait until the camera's results in flight are published and drawn, or the deadline has passed."""
        until_s = self._leaving.until_s or asyncio.get_running_loop().time() + FINISH_S
        with suppress(TimeoutError):
            async with asyncio.timeout_at(until_s):
                await self._inference.settled(camera.key)
                await camera.overlays.drawn()

    def _has_result(self, key: CameraKey) -> None:
        if key in self._took_over:
            self._took_over[key]()

    async def _keep_pace(self) -> None:
        """Ask gateways for no more frames than can be used, until cancelled."""
        shared_by: set[CameraKey] = set()
        while True:
            await asyncio.sleep(PACE_PERIOD_S)
            wanted = {key for key, camera in self._cameras.items() if camera.demand.wanted}
            changed = self._pace.look(self._inference.totals(), len(wanted), time.monotonic())
            if changed or wanted != shared_by:
                self._share_pace(self._frame_queue.by_turn(wanted))
            shared_by = wanted

    def _share_pace(self, cameras: Sequence[CameraKey]) -> None:
        """Request the same rate from each camera, one after the other."""
        limit, most = self._pace.limit_hz, self._role.most_hz
        for turn, key in enumerate(cameras):
            if limit is not None:
                each = limit / len(cameras)
                self._asked[key].ask(each if most is None else min(each, most), turn / limit)
            elif self._asked[key].hz != most:
                self._asked[key].ask(most)

    def _details(self) -> dict[str, Any]:
        remarks = [*deviations(self._configured, self._model.tuning), *self._model.remarks]
        return {
            "model": self._model.name,
            "runtime": self._model.runtime[:MAX_LABEL],
            "canary": _canary(self._model)[:MAX_LABEL],
            "remarks": [remark[:MAX_LABEL] for remark in remarks],
            "classes": list(self._model.classes[:MAX_CLASSES]),
            "cameras": self._tallies.loads({key: asked.hz for key, asked in self._asked.items()}),
            "busy_s": self._inference.totals().busy_s,
        }


def _canary(model: Model) -> str:
    return model.canary.label if isinstance(model, FleetModel) and model.canary is not None else ""


log = logging.getLogger(__name__)

FAILED: Final = 1


async def run(settings: DetectorSettings) -> int:
    """Run a worker until cancelled; see `work`. It announces itself only once its model is ready.

    With `--model fleet` it waits for one.

    Raises:
        ModelError: the model cannot be used.
    """
    with (
        tempfile.TemporaryDirectory(prefix="fleetsight-", ignore_cleanup_errors=True) as folder,
        worker_thread("loading") as executor,
    ):
        if settings.follows_fleet:
            return await _follow_fleet(settings, Path(folder), executor)
        log.info("loading %s", settings.model)
        model = await asyncio.get_running_loop().run_in_executor(executor, load_all, settings, Path(folder))
        log.info("%s is ready; worker %s; runtime %s", model.name, settings.worker, model.runtime)
        for remark in model.remarks:
            log.warning("%s", remark)
        try:
            return await work(settings, model)
        finally:
            model.close()


async def work(settings: DetectorSettings, model: Model) -> int:
    """Serve with a working model until cancelled; if the model fails, log why and return the exit code."""
    following = None if settings.opinion else await asyncio.to_thread(tracking, settings, model)
    with _closing(following):
        async with open_bus(settings) as bus:
            return await _serve(bus, settings, model, following)


async def _follow_fleet(settings: DetectorSettings, folder: Path, executor: Executor) -> int:
    """Serve with the model that the registry has in force, also when it changes; wait for a first one."""
    shipped = await asyncio.to_thread(_digests, SHIPPED_MODEL, SHIPPED_EXPORT)
    loading = SuccessiveLoading(settings, folder)
    async with open_bus(settings) as bus, asyncio.TaskGroup() as group:
        cache = ModelCache(await asyncio.to_thread(usable_cache, settings.cache, folder))
        rollout = Rollout(bus, cache, loading.load, executor)
        running = group.create_task(rollout.run())
        try:
            model = await rollout.first(DETECTOR.service, settings.worker)
            log.info("%s is ready; worker %s; runtime %s", model.name, settings.worker, model.runtime)
            is_shipped = partial(_is_one_of, shipped, model)
            following = await asyncio.to_thread(tracking, settings, model, is_shipped)
            with _closing(following):
                code = await _serve(bus, settings, model, following)
                rollout.leave_marked()
                return code
        finally:
            running.cancel()
            if rollout.model is not None:
                rollout.model.close()


def _digests(*files: Path) -> frozenset[str]:
    return frozenset(map(digest_of, files))


def _is_one_of(digests: frozenset[str], model: FleetModel) -> bool:
    return model.in_force.digest in digests


@contextmanager
def _closing(following: Tracking | None) -> Iterator[None]:
    try:
        yield
    finally:
        if following is not None:
            following.close()


async def _serve(bus: Bus, settings: DetectorSettings, model: Model, following: Tracking | None) -> int:
    role = OPINION if settings.opinion else DETECTOR
    tokens, leaving = settings.tokens(role.service), Leaving()
    try:
        async with answering(bus, model, settings.worker, role, leaving, accept_settings=settings.accept_settings):
            worker = DetectorWorker(
                bus,
                model,
                tokens,
                role=role,
                tracking=following,
                max_age_s=settings.max_age_s,
                leaving=leaving,
                regions=Regions(settings.regions),
            )
            await worker.run()
    except* ModelError as failed:
        log.error("%s", _first(failed))  # noqa: TRY400 - the reason is known: no stack says more
    return FAILED


def _first(failed: BaseExceptionGroup[ModelError]) -> ModelError:
    first = failed.exceptions[0]
    return _first(first) if isinstance(first, BaseExceptionGroup) else first
