"""What publishes results on the real bus as the fleet's services do: of ever newer frames, while they are wanted."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from bus import Bus, Publisher, QoS
from schemas import codec
from schemas.detections import ClassList
from schemas.distances import Distances
from schemas.keys import CameraKey, Stream

PERIOD_S = 0.05
SMALL = (ClassList, Distances)


@asynccontextmanager
async def results(
    bus: Bus, camera: CameraKey, stream: Stream, make: Callable[[int], codec.Message]
) -> AsyncIterator[Publisher]:
    """Publish what `make` makes of a number, again and again."""

    async def publish(publisher: Publisher) -> None:
        seq = 0
        while True:
            if publisher.wanted:
                publisher.put(codec.encode(make(seq)))
                seq += 1
            await asyncio.sleep(PERIOD_S)

    schema = type(make(0))
    qos = QoS.RESULT if schema in SMALL else QoS.IMAGE
    async with bus.publisher(camera.stream(stream), qos, encoding=codec.encoding(schema)) as publisher:
        publishing = asyncio.create_task(publish(publisher))
        try:
            yield publisher
        finally:
            publishing.cancel()
            await asyncio.wait([publishing])
