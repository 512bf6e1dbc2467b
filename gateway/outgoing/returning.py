"""Return one stream of results while somebody on the robot's ROS graph listens."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Generic

from bus import LATEST, Bus
from bus.shared_demand import SharedDemand, while_wanted
from gateway.outgoing.stream import StreamReturn
from gateway.outgoing.translators import R
from gateway.ros1.node import Node
from gateway.ros1.publisher import Publication
from schemas.status import ReturnStatus


@dataclass(frozen=True, slots=True)
class Return(Generic[R]):
    """A stream that is offered on ROS."""

    stream: StreamReturn[R]
    demand: SharedDemand
    publication: Publication

    def status(self) -> ReturnStatus:
        """Account for the stream's messages so far."""
        return self.stream.status(
            wanted=self.demand.wanted,
            subscribers=self.publication.subscriber_count,
            slow=self.publication.counters.replaced,
        )

    async def run(self, bus: Bus) -> None:
        """Subscribe on the bus whenever ROS wants the stream, for ever."""
        await while_wanted(self.demand, lambda: self._subscribe(bus))

    async def _subscribe(self, bus: Bus) -> None:
        # No history: ROS's texts carry no stamp, so that a result of long ago would pass for one of now.
        async with bus.subscribe(self.stream.key, LATEST, history=False) as results:
            async for sample in results:
                message = self.stream.take(sample.payload, sample.encoding, sample.replaced)
                if message is not None:
                    self.publication.publish(message)


@asynccontextmanager
async def returning(node: Node, stream: StreamReturn[R]) -> AsyncIterator[Return[R]]:
    """Offer a stream on ROS for as long as the context lasts."""
    demand = SharedDemand()
    on_demand = demand.of(stream.topic)
    async with node.advertise(stream.topic, stream.translator.ros_type, on_demand=on_demand) as publication:
        yield Return(stream, demand, publication)
