"""A detector worker: every camera's newest frame through the model, results to who wants them."""

import asyncio
import logging
import time
from collections import defaultdict

from bus import Bus, QoS
from schemas import codec, keys
from schemas.detections import Detections
from schemas.errors import SchemaError
from schemas.keys import CameraKey, Stream
from schemas.status import MAX_STREAMS, WorkerStatus
from services.detector.account import UNWANTED, Account
from services.detector.board import Board, Waiting
from services.detector.camera import Camera, feed, serving
from services.detector.model import Failed, Model, Request

log = logging.getLogger(__name__)

SERVICE = "detector"
STATUS_PERIOD_S = 1.0


class Worker:
    """Serves every camera that is there."""

    def __init__(self, bus: Bus, model: Model, name: str) -> None:
        self._bus = bus
        self._model = model
        self._name = name
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
        async with self._turns[key], serving(self._bus, key, account, segments=self._model.segments) as camera:
            self._cameras[key] = camera
            try:
                await feed(self._bus, camera, self._board, self._name)
            finally:
                del self._cameras[key]

    async def _infer(self) -> None:
        room = asyncio.Semaphore(self._model.in_flight)
        async with asyncio.TaskGroup() as group:
            while True:
                await room.acquire()
                key, waiting = await self._board.take()
                camera = self._cameras.get(key)
                if camera is None or not camera.demand.wanted:
                    self._accounts[key].dropped[UNWANTED] += 1
                    room.release()
                    continue
                group.create_task(self._look(camera, waiting)).add_done_callback(lambda _: room.release())

    async def _look(self, camera: Camera, waiting: Waiting) -> None:
        begun_ns = time.time_ns()
        frame = waiting.frame
        (outcome,) = await self._model.infer([Request(camera.key, frame, camera.wants_masks)])
        if isinstance(outcome, Failed):
            camera.account.dropped[outcome.reason] += 1
            about = frame.header
            log.warning("%s: frame %s/%d %s: %s", camera.key, about.boot_id, about.seq, outcome.reason, outcome.error)
            return
        camera.account.inferred += 1
        found = Detections(
            header=frame.header,
            height=frame.height,
            width=frame.width,
            objects=outcome.objects,
            model=self._model.name,
            worker=self._name,
            spans={"queue": max(0, begun_ns - waiting.arrived_ns), **outcome.spans},
        )
        camera.publish(found, frame)

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
            remarks=list(self._model.remarks),
            cameras=[account.load() for account in list(self._accounts.values())[-MAX_STREAMS:]],
        )
