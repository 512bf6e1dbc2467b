"""A detector worker: every camera's newest frame through the model, one call at a time, results to who wants them."""

import asyncio
import logging
import time
from collections import defaultdict
from concurrent.futures import Executor

from bus import Bus, QoS
from schemas import codec, keys
from schemas.detections import Detection, Detections
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from schemas.status import MAX_STREAMS, WorkerStatus
from services.detector.account import FAILED, MALFORMED, UNWANTED, Account
from services.detector.board import Board, Waiting
from services.detector.camera import Camera, feed, serving
from services.detector.model import Model
from services.detector.pixels import PictureError, to_bgr

log = logging.getLogger(__name__)

SERVICE = "detector"
STATUS_PERIOD_S = 1.0


class Worker:
    """Serves every camera that is there. `executor` runs the model, off the event loop."""

    def __init__(self, bus: Bus, model: Model, name: str, executor: Executor) -> None:
        self._bus = bus
        self._model = model
        self._name = name
        self._executor = executor
        self._board = Board()
        self._cameras: dict[CameraKey, Camera] = {}
        self._accounts: dict[CameraKey, Account] = {}
        self._turns: defaultdict[CameraKey, asyncio.Lock] = defaultdict(asyncio.Lock)

    async def run(self) -> None:
        """Work until cancelled."""
        async with self._bus.announce(keys.worker_alive(SERVICE, self._name)), asyncio.TaskGroup() as group:
            group.create_task(self._report())
            group.create_task(self._infer())
            group.create_task(self._follow_cameras())

    async def _follow_cameras(self) -> None:
        served: dict[CameraKey, asyncio.Task[None]] = {}
        async with (
            self._bus.watch(keys.every_stream_alive(Stream.COLOR)) as watch,
            asyncio.TaskGroup() as group,
        ):
            async for presence in watch:
                try:
                    key = keys.parse_stream(presence.key).camera
                except SchemaError as error:
                    log.warning("%s: camera left out: %s", presence.key, error)
                    continue
                previous = served.pop(key, None)
                if previous is not None:
                    previous.cancel()
                if presence.alive and len(served) >= MAX_STREAMS:
                    log.warning("%s: camera left out: %d are served already", key, len(served))
                elif presence.alive:
                    served[key] = group.create_task(self._serve(key))

    async def _serve(self, key: CameraKey) -> None:
        """Serve a camera that is there (again), once what served it before has ended."""
        account = self._accounts.setdefault(key, Account(key))
        async with self._turns[key], serving(self._bus, key, account) as camera:
            self._cameras[key] = camera
            try:
                await feed(self._bus, camera, self._board, self._name)
            finally:
                del self._cameras[key]

    async def _infer(self) -> None:
        while True:
            key, waiting = await self._board.take()
            camera = self._cameras.get(key)
            if camera is None or not camera.demand.wanted:
                self._accounts[key].dropped[UNWANTED] += 1
                continue
            try:
                found = await self._detect(waiting, masks=camera.detections.wanted)
            except PictureError as error:
                camera.account.dropped[MALFORMED] += 1
                log.warning("%s: frame %d left out: %s", key, waiting.frame.header.seq, error)
                continue
            except Exception as error:  # noqa: BLE001 - whatever a frame does to the model, it fails alone
                camera.account.dropped[FAILED] += 1
                log.warning("%s: frame %d failed in the model: %r", key, waiting.frame.header.seq, error)
                continue
            camera.account.inferred += 1
            camera.publish(found)

    async def _detect(self, waiting: Waiting, *, masks: bool) -> Detections:
        begun_ns = time.time_ns()
        loop = asyncio.get_running_loop()
        objects, model_ns = await loop.run_in_executor(self._executor, self._call_model, waiting.frame, masks)
        return Detections(
            header=waiting.frame.header,
            height=waiting.frame.height,
            width=waiting.frame.width,
            objects=objects,
            model=self._model.name,
            worker=self._name,
            spans={"queue": max(0, begun_ns - waiting.arrived_ns), "model": model_ns},
        )

    def _call_model(self, frame: ImageFrame, masks: bool) -> tuple[list[Detection], int]:  # noqa: FBT001
        begun_ns = time.perf_counter_ns()
        objects = self._model.infer(to_bgr(frame), masks=masks)
        return objects, time.perf_counter_ns() - begun_ns

    async def _report(self) -> None:
        key = keys.worker_status(SERVICE, self._name)
        async with self._bus.publisher(key, QoS.STATUS, encoding=codec.encoding(WorkerStatus)) as publisher:
            try:
                while True:
                    publisher.put(codec.encode(self._status()))
                    await asyncio.sleep(STATUS_PERIOD_S)
            finally:
                publisher.put(codec.encode(self._status()))

    def _status(self) -> WorkerStatus:
        return WorkerStatus(
            service=SERVICE,
            worker=self._name,
            model=self._model.name,
            sent_ns=time.time_ns(),
            cameras=[account.load() for account in list(self._accounts.values())[-MAX_STREAMS:]],
        )
