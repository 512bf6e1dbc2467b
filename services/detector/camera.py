"""One camera at a worker: its publishers, and its frames on their way to the model while somebody wants results."""

from collections.abc import AsyncIterator
from concurrent.futures import Executor
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from dataclasses import dataclass

from bus import Bus, Publisher, QoS
from bus.demand import SharedDemand
from schemas import codec
from schemas.detections import KEPT_LISTS, ClassList, Detections, class_list
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from services.detector.account import Account
from services.detector.drawing import MASKS, Overlays, drawing
from services.detector.role import DETECTOR, Role


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera's results and the demand for them. detections: None where class lists are all that is made."""

    key: CameraKey
    account: Account
    demand: SharedDemand
    detections: Publisher | None
    classes: Publisher
    overlays: Overlays

    @property
    def wants_masks(self) -> bool:
        """Whether somebody has a use for masks."""
        return self._wants_detections or self.overlays.wants_masks

    @property
    def wants_tracks(self) -> bool:
        """Whether somebody has a use for the numbers of tracks."""
        return self._wants_detections or self.overlays.wanted

    @property
    def _wants_detections(self) -> bool:
        return self.detections is not None and self.detections.wanted

    def publish_classes(self, found: Detections) -> None:
        """Publish the list of classes if somebody wants it."""
        if self.classes.wanted:
            self.classes.put(codec.encode(class_list(found)))

    def publish_objects(self, found: Detections, frame: ImageFrame) -> None:
        """Publish what somebody wants of the objects; the overlays follow when they are drawn."""
        if self.detections is not None and self.detections.wanted:
            self.detections.put(codec.encode(found))
        self.overlays.offer(found, frame)


@asynccontextmanager
async def serving(
    bus: Bus,
    key: CameraKey,
    account: Account,
    *,
    role: Role = DETECTOR,
    segments: bool = True,
    painters: Executor | None = None,
) -> AsyncIterator[Camera]:
    """Declare a camera's result streams for as long as the context lasts.

    role: says which there are. segments: whether there are masks to draw. painters: see `drawing`.
    """
    demand = SharedDemand()

    def declare(
        stream: Stream, qos: QoS, schema: type[codec.Message], *, kept: int = 1
    ) -> AbstractAsyncContextManager[Publisher]:
        encoding = codec.encoding(schema)
        return bus.publisher(key.stream(stream), qos, encoding=encoding, kept=kept, on_demand=demand.of(stream))

    async with AsyncExitStack() as stack:
        classes = await stack.enter_async_context(declare(role.lists, QoS.RESULT, ClassList, kept=KEPT_LISTS))
        detections = (
            None
            if role.lists_only
            else await stack.enter_async_context(declare(Stream.DETECTIONS, QoS.RESULT, Detections))
        )
        publishers = {
            stream: await stack.enter_async_context(declare(stream, QoS.IMAGE, ImageFrame))
            for stream, masks in MASKS.items()
            if not role.lists_only and (segments or not masks)
        }
        overlays = await stack.enter_async_context(drawing(publishers, painters))
        yield Camera(key, account, demand, detections, classes, overlays)
