"""Returns one stream of results while a node on the robot's ROS graph subscribes."""

import asyncio
import logging
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from dataclasses import dataclass, field
from typing import Generic

from bus import Bus, Sample
from bus.demand import SharedDemand, while_wanted
from gateway.ros1.errors import MessageError, Ros1Error
from gateway.ros1.node import Node
from gateway.ros1.tcpros.publisher import Publication
from gateway.to_ros.stream import R, StreamReturn
from schemas.errors import SchemaError
from schemas.status import ReturnStatus

log = logging.getLogger(__name__)


@dataclass(slots=True)
class Return(Generic[R]):
    """A stream offered on ROS. publications: by topic, while it runs."""

    stream: StreamReturn[R]
    demand: SharedDemand = field(default_factory=SharedDemand)
    publications: dict[str, Publication] = field(default_factory=dict)

    def status(self) -> ReturnStatus:
        """Return the counts of the stream's messages so far."""
        return self.stream.status(
            wanted=self.demand.wanted,
            subscribers=sum(publication.subscriber_count for publication in self.publications.values()),
            slow=self._slow(),
        )

    def _slow(self) -> int:
        return sum(publication.counters.replaced for publication in self.publications.values())

    async def run(self, node: Node, bus: Bus) -> None:
        """Advertise on ROS, and subscribe on the bus while ROS wants the stream, forever. Run once.

        Returns at once, and says so in the log, where the node cannot advertise: remapped, a camera that was found may
        have a topic that is in use.
        """
        try:
            async with AsyncExitStack() as stack:
                try:
                    for topic in self.stream.topics.values():
                        self.publications[topic] = await stack.enter_async_context(self._advertise(node, topic))
                except Ros1Error as error:
                    log.warning("%s is not returned: %s", self.stream.key, error)
                    return
                self.demand.of("the gateway itself")(self.stream.translator.eager)
                await while_wanted(self.demand, lambda: self._subscribe(bus))
        finally:
            self.stream.retire(slow=self._slow())
            self.publications.clear()

    def _advertise(self, node: Node, topic: str) -> AbstractAsyncContextManager[Publication]:
        translator = self.stream.translator
        return node.advertise(
            topic,
            translator.ros_type,
            latch=translator.latched,
            queue_size=translator.waiting,
            on_demand=self.demand.of(topic),
        )

    async def _subscribe(self, bus: Bus) -> None:
        # No history for results without a time: an old one would pass for a current one.
        translator = self.stream.translator
        async with bus.subscribe(str(self.stream.key), translator.keep, history=translator.latched) as results:
            async for sample in results:
                await self._take(sample)

    async def _take(self, sample: Sample) -> None:
        result = self.stream.receive(sample.payload, sample.encoding, sample.replaced)
        if result is None:
            return
        publication = self.publications[self.stream.topic_of(result)]
        if self.stream.translator.eager and not publication.wanted:
            self.stream.unheard(result)
            return
        try:
            message = await self._translate(result)
        except (MessageError, SchemaError) as error:
            self.stream.leave_out(error)
            return
        self.stream.returned(result)
        publication.publish(message)

    async def _translate(self, result: R) -> bytes:
        translator, number = self.stream.translator, self.stream.next_number
        if translator.heavy:
            return await asyncio.to_thread(translator.translate, result, number)
        return translator.translate(result, number)
