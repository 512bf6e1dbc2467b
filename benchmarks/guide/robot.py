"""The robot's own ROS graph, as far as it is here: its sensors' drivers, and who listens to the outputs."""

import asyncio
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from itertools import count

from benchmarks.guide.outputs import stamp_ns
from benchmarks.guide.scene import MOVING, SENSORS, STATIC, Scene
from benchmarks.guide.sets import Arrival
from gateway.ros1.node import Node
from gateway.ros1.tcpros.publisher import Publication
from gateway.ros1.tcpros.subscriber import Message
from services.simulator.topics import Topic


class Robot:
    """Publishes instants when told to, and keeps what arrives. outputs: topics and types of a whole set."""

    def __init__(self, scene: Scene, outputs: Mapping[str, str], publications: Mapping[Topic, Publication]) -> None:
        self.outputs = outputs
        self.arrivals: list[Arrival] = []
        self._scene = scene
        self._publications = publications
        self._numbers = count()

    async def drive(self, hz: float, seconds: float) -> list[int]:
        """Measure `hz` times a second; return the stamps. Ends when the last instant's time is over."""
        loop, stamps = asyncio.get_running_loop(), []
        begun_s = loop.time()
        for number in range(1, max(1, round(hz * seconds)) + 1):
            stamps.append(await self._measure())
            await asyncio.sleep(begun_s + number / hz - loop.time())
        return stamps

    async def _measure(self) -> int:
        """Publish an instant, each message before the next one is made: a camera waits for no other sensor."""
        stamp = time.time_ns()
        for topic, message in self._scene.messages(next(self._numbers), stamp):
            self._publications[topic].publish(message)
            await asyncio.sleep(0)
        return stamp

    def taken(self) -> list[Arrival]:
        """Return what arrived, and forget it."""
        arrivals, self.arrivals = self.arrivals, []
        return arrivals

    def take(self, topic: str, message: Message) -> None:
        """Note an output."""
        now_ns = time.time_ns()
        stamp = stamp_ns(self.outputs[topic], message.data)
        self.arrivals.append(Arrival(topic, now_ns, stamp, len(message.data)))


@asynccontextmanager
async def robot(master: str, scene: Scene, outputs: Mapping[str, str]) -> AsyncIterator[Robot]:
    """Be on the ROS graph of a master."""
    async with (
        Node("/sensors", master_uri=master) as drivers,
        Node("/listener", master_uri=master) as listener,
        AsyncExitStack() as stack,
    ):
        publications = {
            topic: await stack.enter_async_context(
                drivers.advertise(f"/{topic.name}", topic.type, latch=topic.latched, queue_size=topic.queue_size)
            )
            for topic in (STATIC, MOVING, *SENSORS)
        }
        publications[STATIC].publish(scene.static(time.time_ns()))
        made = Robot(scene, outputs, publications)
        for topic, kind in outputs.items():
            await stack.enter_async_context(listener.subscribe(topic, kind, partial(made.take, topic)))
        yield made
