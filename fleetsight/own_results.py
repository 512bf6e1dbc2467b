"""Results of one's own model for a camera's images, published while somebody wants them."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from typing import Final

import msgspec

from bus import Bus, Publisher, QoS
from bus.demand import SharedDemand
from fleetsight.errors import ClosedError, MessageError, translated
from fleetsight.streams import Iterations
from schemas import codec
from schemas.codec import M
from schemas.detections import KEPT_LISTS, ClassList, Detections, class_list
from schemas.errors import SchemaError
from schemas.keys import CameraKey, Stream

UNREADABLE: Final = "nobody could read that; use Python's own float, int and str, within the bounds of the contract"


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
        self,
        camera: CameraKey,
        demand: SharedDemand,
        classes: Publisher,
        detections: Publisher | None,
        ended: asyncio.Future[None],
    ) -> None:
        self.camera = camera
        self._demand = demand
        self._classes = classes
        self._detections = detections
        self._ended = ended

    @property
    def wanted(self) -> bool:
        """Whether somebody, anywhere, wants what is found in this camera's images; False once the context has ended."""
        return self._demand.wanted and not self._ended.done()

    async def until_wanted(self) -> None:
        """Wait until somebody wants what is found; see `publish`.

        Raises:
            ClosedError: the context has ended, or the fleet was left: nobody will want anything.
        """
        await self._until(wanted=True)
        if self._ended.done():
            raise ClosedError(f"results of {self.camera}: their context has ended; wait within `async with`")

    async def until_unwanted(self) -> None:
        """Wait until nobody wants what is found any more, or the context has ended."""
        await self._until(wanted=False)

    async def _until(self, *, wanted: bool) -> None:
        waiting = asyncio.ensure_future(self._demand.until(wanted=wanted))
        try:
            await asyncio.wait({waiting, self._ended}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            waiting.cancel()

    def publish(self, found: Detections) -> None:
        """Publish what was found in one image, as detections and as a class list, to those who want either.

        `found.header` is that of the image. Nobody wants anything once the context has ended.

        Raises:
            MessageError: nobody could read it: the header is of another camera, or a value is out of its bounds or of
                another type than the contract says, such as a number of NumPy's.

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
        with readable(self.camera):
            payload, read = _encoded(Detections, found)
            codec.check_identity(read.header, self.camera)
            classes, _ = _encoded(ClassList, class_list(read))
        if self._classes.wanted:
            self._classes.put(classes)
        if self._detections is not None and self._detections.wanted:
            self._detections.put(payload)


@contextmanager
def readable(camera: CameraKey) -> Iterator[None]:
    """Raise as MessageError that a message about a camera cannot be made of what it is given."""
    try:
        yield
    except (SchemaError, msgspec.MsgspecError, AttributeError, TypeError, ValueError, OverflowError) as error:
        raise MessageError(f"results of {camera}: {error}; {UNREADABLE}") from error


def _encoded(schema: type[M], message: M) -> tuple[bytes, M]:
    """Return a message as bytes, and as its readers have it. Raises what msgspec does, and SchemaError."""
    payload = codec.encode(message)
    return payload, codec.decode(schema, payload, codec.encoding(schema))


@asynccontextmanager
async def publishing(
    bus: Bus,
    iterations: Iterations,
    camera: CameraKey,
    *,
    opinion: bool = False,
    demand: SharedDemand | None = None,
) -> AsyncIterator[Results]:
    """Publish a camera's results for as long as the context lasts.

    opinion: publish class lists alone, as a second opinion, which does not count. demand: set by whoever wants them.
    """
    demand = SharedDemand() if demand is None else demand
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
        with iterations.context() as ended:
            yield Results(camera, demand, classes, detections, ended)
