"""Return one stream of results while somebody on the robot's ROS graph listens."""

from dataclasses import dataclass, field
from typing import Generic

from bus import LATEST, Bus
from bus.shared_demand import SharedDemand, while_wanted
from gateway.outgoing.stream import StreamReturn
from gateway.outgoing.translators import R
from gateway.ros1.node import Node
from gateway.ros1.publisher import Publication
from schemas.status import ReturnStatus


@dataclass(slots=True)
class Return(Generic[R]):
    """A stream that is offered on ROS while it runs."""

    stream: StreamReturn[R]
    demand: SharedDemand = field(default_factory=SharedDemand)
    publication: Publication | None = None

    def status(self) -> ReturnStatus:
        """Account for the stream's messages so far."""
        return self.stream.status(
            wanted=self.demand.wanted,
            subscribers=self.publication.subscriber_count if self.publication else 0,
            slow=self.publication.counters.replaced if self.publication else 0,
        )

    async def run(self, node: Node, bus: Bus) -> None:
        """Advertise on ROS and subscribe on the bus whenever ROS wants the stream, for ever. To be run once."""
        topic, on_demand = self.stream.topic, self.demand.of(self.stream.topic)
        async with node.advertise(topic, self.stream.translator.ros_type, on_demand=on_demand) as publication:
            self.publication = publication
            await while_wanted(self.demand, lambda: self._subscribe(bus, publication))

    async def _subscribe(self, bus: Bus, publication: Publication) -> None:
        # No history: ROS's texts carry no stamp, so that a result of long ago would pass for one of now.
        async with bus.subscribe(self.stream.key, LATEST, history=False) as results:
            async for sample in results:
                message = self.stream.take(sample.payload, sample.encoding, sample.replaced)
                if message is not None:
                    publication.publish(message)
