"""A simulated robot on a ROS 1 graph."""

import asyncio
import time
from collections.abc import Iterable, Mapping
from concurrent.futures import Executor
from contextlib import AsyncExitStack
from functools import partial

from gateway.ros1.node import Node
from gateway.ros1.tcpros.publisher import Publication
from services.simulator.robot import Robot
from services.simulator.topics import Content, Topic


class LiveRobot:
    """Publishes a robot's topics `hz` times a second. `executor` measures, off the event loop.

    delay_s: before the first time, so that the robots of a fleet take turns. begun_s: the event loop's time from which
    the fleet's seconds count; None for this robot's own start.
    """

    def __init__(self, robot: Robot, hz: float, delay_s: float = 0.0, begun_s: float | None = None) -> None:
        self.robot = robot
        self._period_s = 1 / hz
        self._delay_s = delay_s
        self._begun_s = begun_s
        self._publications: Mapping[Topic, Publication] = {}

    @property
    def sent(self) -> int:
        """The number of colour images handed to subscribers so far."""
        return sum(
            publication.counters.sent
            for topic, publication in self._publications.items()
            if topic.content is Content.COLOR
        )

    async def run(self, node: Node, executor: Executor) -> None:
        """Drive until cancelled. Only topics with subscribers are measured and sent."""
        async with AsyncExitStack() as stack:
            self._publications = {
                topic: await stack.enter_async_context(
                    node.advertise(self.robot.path(topic), topic.type, latch=topic.latched, queue_size=topic.queue_size)
                )
                for topic in self.robot.topics
            }
            latched = [topic for topic in self.robot.topics if topic.latched]
            self._publish(self.robot.publish(0, latched, time.time_ns))
            await self._drive(executor)

    async def _drive(self, executor: Executor) -> None:
        loop = asyncio.get_running_loop()
        begun_s = (loop.time() if self._begun_s is None else self._begun_s) + self._delay_s
        number = max(0, round((loop.time() - begun_s) / self._period_s))
        while True:
            await asyncio.sleep(begun_s + number * self._period_s - loop.time())
            if wanted := self._wanted():
                second = self._delay_s + number * self._period_s
                publish = partial(self.robot.publish, number, wanted, time.time_ns, second)
                self._publish(await loop.run_in_executor(executor, publish))
            number = max(number + 1, round((loop.time() - begun_s) / self._period_s))

    def _wanted(self) -> list[Topic]:
        return [
            topic
            for topic, publication in self._publications.items()
            if publication.subscriber_count and not topic.latched
        ]

    def _publish(self, messages: Iterable[tuple[Topic, bytes]]) -> None:
        for topic, message in messages:
            self._publications[topic].publish(message)
