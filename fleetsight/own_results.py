"""Results of one's own model for a camera's images, published while somebody wants them."""

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

from bus import Bus, Publisher, QoS
from bus.demand import SharedDemand
from fleetsight.errors import MessageError, translated
from schemas import codec
from schemas.detections import KEPT_LISTS, ClassList, Detections, class_list
from schemas.errors import SchemaError
from schemas.keys import CameraKey, Stream


class Results:
    """Publishes the detections and class lists of one camera, while somebody wants them.

    >>> async def main():
    ...     async with (
    ...         fleetsight.connect(endpoint) as fleet,
    ...         fleet.results("r7", "rear") as results,
    ...     ):
    ...         print(results.camera, results.wanted)
    >>> asyncio.run(main())
    r7/rear False
    """

    def __init__(
        self, camera: CameraKey, demand: SharedDemand, classes: Publisher, detections: Publisher | None
    ) -> None:
        self.camera = camera
        self.demand = demand
        self._classes = classes
        self._detections = detections

    @property
    def wanted(self) -> bool:
        """Whether somebody, anywhere, wants what is found in this camera's images."""
        return self.demand.wanted

    async def until_wanted(self) -> None:
        """Wait until somebody wants what is found; see `publish`."""
        await self.demand.until(wanted=True)

    async def until_unwanted(self) -> None:
        """Wait until nobody wants what is found any more."""
        await self.demand.until(wanted=False)

    def publish(self, found: Detections) -> None:
        """Publish what was found in one image, as detections and as a class list, to those who want either.

        `found.header` is that of the image. Nobody wants anything once the context has ended.

        Raises:
            MessageError: the header is of another camera, or a value is out of its bounds: nobody could read it.

        >>> header = fleetsight.Header(
        ...     robot="r7", camera="rear", boot_id="mine", seq=0, stamp_ns=0, frame_id="rear", received_ns=0
        ... )
        >>> found = fleetsight.Detections(header=header, height=4, width=6, objects=[], model="mine", worker="me")
        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet, fleet.results("r7", "rear") as results:
        ...         listening = asyncio.ensure_future(anext(aiter(fleet.class_lists("r7"))))
        ...         await results.until_wanted()
        ...         results.publish(found)
        ...         return (await listening).classes
        >>> asyncio.run(main())
        []
        """
        if not self.wanted:
            return
        payload = codec.encode(found)
        try:
            codec.check_identity(found.header, self.camera)
            codec.decode(Detections, payload, codec.encoding(Detections))
        except SchemaError as error:
            raise MessageError(f"results of {self.camera}: {error}; nobody could read that") from error
        if self._classes.wanted:
            self._classes.put(codec.encode(class_list(found)))
        if self._detections is not None and self._detections.wanted:
            self._detections.put(payload)


@asynccontextmanager
async def publishing(bus: Bus, camera: CameraKey, *, opinion: bool = False) -> AsyncIterator[Results]:
    """Publish a camera's results for as long as the context lasts.

    opinion: publish class lists alone, as a second opinion, which does not count.
    """
    demand = SharedDemand()
    lists = Stream.OPINION if opinion else Stream.CLASSES
    encodings = {lists: codec.encoding(ClassList), Stream.DETECTIONS: codec.encoding(Detections)}

    async with AsyncExitStack() as stack:

        async def declared(stream: Stream, kept: int) -> Publisher:
            publisher = bus.publisher(
                camera.stream(stream),
                QoS.RESULT,
                encoding=encodings[stream],
                kept=kept,
                on_demand=demand.of(stream),
            )
            return await stack.enter_async_context(publisher)

        with translated(f"results of {camera}"):
            classes = await declared(lists, KEPT_LISTS)
            detections = None if opinion else await declared(Stream.DETECTIONS, 1)
        yield Results(camera, demand, classes, detections)
