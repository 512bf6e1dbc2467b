"""A model of one's own as a worker of the fleet: it shares the cameras with the fleet's detectors."""

import asyncio
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Sequence
from typing import Final

from bus import LATEST, Bus, BusClosedError, Sample
from bus.clocks import clock_id
from bus.delivery.inbox import Inbox
from bus.delivery.mailbox import PerKey
from bus.demand import SharedDemand, while_wanted
from bus.reporting import VERSION, report
from bus.sharing import Sharing, SharingSettings
from bus.sharing.rate_request import RateRequest
from bus.sharing.sharing import say_unwanted
from bus.sharing.work_counts import Tallies, Tally
from fleetsight.errors import FleetsightError, translated
from fleetsight.own_results import Results, publishing, readable
from fleetsight.streams import Iterations
from schemas import codec, worker_keys
from schemas.consumer_keys import Wanted
from schemas.detections import Detection, Detections
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream, StreamKey
from schemas.status import WorkerStatus

Find = Callable[[ImageFrame], Awaitable[Sequence[Detection]]]
"""An async function that takes an `ImageFrame` and returns its `Detection`s, with boxes in pixels of the image.

Its exceptions end `OwnModel.run`, which raises them.
"""

REPLACED: Final = "replaced by a newer frame"
MALFORMED: Final = "malformed"
UNWANTED: Final = "no longer wanted"


class OwnModel:
    """Has `find` look at the images of the cameras that fall to it, one image at a time, while results are wanted.

    Of the images that come meanwhile the newest of each camera waits; the camera looked at longest ago is next.
    sharing: under which name it works, for which robots. most_hz: images a second of one camera that are asked for.
    """

    def __init__(
        self,
        bus: Bus,
        iterations: Iterations,
        find: Find,
        model: str,
        sharing: SharingSettings,
        *,
        classes: Sequence[str] = (),
        opinion: bool = False,
        most_hz: float | None = None,
    ) -> None:
        self._bus = bus
        self._iterations = iterations
        self._find = find
        self._model = model
        self._worker = sharing.worker
        self._service = worker_keys.OPINION if opinion else worker_keys.DETECTOR
        self._tokens = sharing.tokens(self._service)
        self._classes = classes
        self._opinion = opinion
        self._most_hz = most_hz
        self._images: Inbox[ImageFrame] = Inbox(PerKey(), asyncio.get_running_loop())
        self._served: dict[str, tuple[Results, Tally, Callable[[], None]]] = {}
        self._tallies = Tallies(Tally)
        self._finding: float | None = None  # since when, on the loop's clock
        self._failure: BaseException | None = None

    async def run(self) -> None:
        """Work until cancelled, then leave the cameras to others.

        Raises:
            MessageError: nobody could read what `find` returned.
            ClosedError: the fleet was left.
            BaseException: `find` raised it.
        """
        with translated(f"model {self._model}"):
            await self._work()
        if self._failure is not None:  # raised here, it keeps its own cause
            raise self._failure

    async def _work(self) -> None:
        """Work until cancelled, or until there is a failure."""
        sharing = Sharing(self._bus, self._tokens, Stream.COLOR, self._serve, pending=lambda: self._finding)
        status = worker_keys.worker_status(self._service, self._worker)
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(report(self._bus, status, WorkerStatus, self._status))
                group.create_task(self._look())
                await sharing.run()
        except BaseExceptionGroup as group:
            if self._failure is not None:
                return
            if group.subgroup(BusClosedError):
                raise BusClosedError("the bus is closed") from group
            raise

    async def _serve(self, camera: CameraKey, took_over: Callable[[], None]) -> None:
        demand = SharedDemand()
        with self._tallies.serving(camera) as tally:
            async with (
                publishing(self._bus, self._iterations, camera, opinion=self._opinion, demand=demand) as results,
                asyncio.TaskGroup() as group,
            ):
                self._served[str(camera)] = (results, tally, took_over)
                group.create_task(say_unwanted(demand, took_over))
                try:
                    await while_wanted(demand, lambda: self._receive(camera, tally.dropped))
                finally:
                    del self._served[str(camera)]

    async def _receive(self, camera: CameraKey, dropped: Counter[str]) -> None:
        color, asked = StreamKey(camera, Stream.COLOR), RateRequest()
        asked.ask(self._most_hz)
        async with (
            self._bus.announce(str(Wanted(color, clock_id(), self._worker))),
            asyncio.TaskGroup() as group,
            self._bus.subscribe(str(color), LATEST, history=False) as frames,
        ):
            telling = group.create_task(asked.tell(self._bus, color, self._worker))
            async for sample in frames:
                dropped[REPLACED] += sample.replaced
                self._accept(camera, sample, dropped)
            telling.cancel()

    def _accept(self, camera: CameraKey, sample: Sample, dropped: Counter[str]) -> None:
        try:
            frame = codec.decode(ImageFrame, sample.payload, sample.encoding)
            codec.check_identity(frame.header, camera)
        except SchemaError:
            dropped[MALFORMED] += 1
        else:
            self._images.offer(str(camera), frame)

    async def _look(self) -> None:
        while True:
            taken = await self._images.take()
            if taken.key not in self._served:
                continue
            results, tally, took_over = self._served[taken.key]
            tally.dropped[REPLACED] += taken.dropped
            if not results.wanted:
                tally.dropped[UNWANTED] += 1
                continue
            try:
                objects = await self._found(taken.item)
                with readable(results.camera):
                    found = self._detections(taken.item, objects)
                results.publish(found)
            except asyncio.CancelledError:
                raise
            except BaseException as error:
                self._failure = error
                raise
            tally.done += 1
            took_over()

    async def _found(self, frame: ImageFrame) -> Sequence[Detection]:
        self._finding = asyncio.get_running_loop().time()
        try:
            return await self._find(frame)
        except asyncio.CancelledError as error:
            task = asyncio.current_task()
            if task is None or task.cancelling():
                raise
            raise FleetsightError(  # as it is, it would end this task alone
                f"model {self._model}: find was cancelled, and not by the service; catch CancelledError where it waits"
            ) from error
        finally:
            self._finding = None

    def _detections(self, frame: ImageFrame, objects: Sequence[Detection]) -> Detections:
        return Detections(
            header=frame.header,
            height=frame.height,
            width=frame.width,
            objects=sorted(objects, key=lambda each: -each.score),
            model=self._model,
            worker=self._worker,
        )

    def _status(self) -> WorkerStatus:
        return WorkerStatus(
            service=self._service,
            worker=self._worker,
            model=self._model,
            sent_ns=time.time_ns(),
            classes=list(self._classes),
            cameras=self._tallies.loads(),
            version=VERSION,
        )
