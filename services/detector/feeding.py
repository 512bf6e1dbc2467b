"""One camera's frames on their way to the model, while somebody wants results."""

import asyncio
import logging
from collections.abc import Callable

from bus import LATEST, Bus, Sample
from bus.clocks import clock_id
from bus.demand import while_wanted
from bus.sharing.rate_request import Asked
from schemas import codec
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from schemas.keys import Stream, StreamKey, Wanted
from schemas.status import UNWANTED
from services.detector.account import DEPTH, REPLACED, SPARED
from services.detector.board import Board, Waiting
from services.detector.camera import Camera
from services.detector.lateness import Lateness
from services.detector.pixels import shows_colours
from services.detector.role import Role
from services.detector.thinning import Thinning

log = logging.getLogger(__name__)


async def feed(bus: Bus, camera: Camera, board: Board, asked: Asked, *, worker: str, role: Role) -> None:
    """Put the camera's newest frame on the board whenever its results are wanted, for ever.

    asked: how many frames its gateway is asked for; who gives a second opinion spares the others, which come if others
    ask for them. worker, role: under whose name the gateway is told where they go.
    """
    color, consumer = StreamKey(camera.key, Stream.COLOR), role.consumer(worker)

    async def receive() -> None:
        camera.account.begin()
        lateness, thinning = Lateness(), Thinning()

        def passes(arrived_ns: int) -> bool:
            return role.most_hz is None or asked.hz is None or thinning.passes(arrived_ns, asked.hz, asked.from_ns)

        try:
            async with (
                bus.announce(str(Wanted(color, clock_id(), consumer))),
                asyncio.TaskGroup() as group,
                bus.subscribe(str(color), LATEST, history=False) as frames,
            ):
                telling = group.create_task(asked.tell(bus, color, consumer))
                try:
                    async for sample in frames:
                        accept(camera, board, sample, lateness, passes)
                    telling.cancel()
                finally:
                    camera.account.dropped[UNWANTED] += frames.counts.unread
        finally:
            camera.account.dropped[UNWANTED] += board.discard(camera.key)

    await while_wanted(camera.demand, receive)


def accept(camera: Camera, board: Board, sample: Sample, lateness: Lateness, passes: Callable[[int], bool]) -> None:
    """Put a frame on the board, or count why not. passes: says of one that arrived then whether it is looked at."""
    try:
        frame = codec.decode(ImageFrame, sample.payload, sample.encoding)
        codec.check_identity(frame.header, camera.key)
    except SchemaError as error:
        camera.account.malformed(sample.replaced)
        log.warning("%s: frame left out: %s", camera.key, error)
        return
    if not camera.account.arrived(frame.header, sample.replaced):
        return
    if not shows_colours(frame):
        camera.account.dropped[DEPTH] += 1
        return
    if not passes(sample.received_ns):
        camera.account.dropped[SPARED] += 1
        return
    late_ns = lateness.late_ns(frame.header.received_ns, sample.received_ns)
    camera.account.dropped[REPLACED] += board.post(camera.key, Waiting(frame, sample.received_ns, late_ns))
