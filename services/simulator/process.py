"""The simulator process: starts ROS masters unless one is given, and a node per robot; or writes bags."""

import asyncio
import json
import logging
import os
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path

from gateway.ros1.node import Node
from gateway.ros1.tasks import TaskScope
from gateway.ros1.tcpros.publisher import Publication
from services.simulator.bags import one_each, write_bags
from services.simulator.errors import MasterError
from services.simulator.fleet import robots, warehouse_seed
from services.simulator.floor_plan import write_floor_plan
from services.simulator.progress_bars import bar
from services.simulator.robot import Robot
from services.simulator.ros_master.master import RosMaster
from services.simulator.settings import SimulatorSettings
from services.simulator.topics import Content, Topic

log = logging.getLogger(__name__)


class LiveRobot:
    """Publishes a robot's topics on a ROS graph, `hz` times a second. `executor` measures, off the event loop.

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


async def prerender(fleet: Iterable[Robot], executor: Executor) -> list[Robot]:
    """Make the robots and measure everything their topics need on `executor`, with progress shown."""
    loop = asyncio.get_running_loop()
    robots = await loop.run_in_executor(executor, list, fleet)
    films = {robot.film: robot.parts for robot in robots}
    with bar("rendering", sum(film.frames for film in films)) as done:
        for film, parts in films.items():
            for number in range(film.frames):
                await loop.run_in_executor(executor, film.measure, number, parts)
                done()
    stores = {film.store for film in films}
    log.info("rendered; %.0f MiB kept", sum(store.size for store in stores) / 2**20)
    if any(store.refused for store in stores):
        log.warning("--memory-mib: not everything fits; the rest is rendered again each time")
    return robots


async def run(settings: SimulatorSettings) -> None:
    """Drive the robots until their time is over or until cancelled.

    Raises:
        MasterError: a robot's own ROS master cannot listen where it should.
        BagError: a bag cannot be written.
        FloorPlanError: the floor plan cannot be written.
    """
    with ThreadPoolExecutor(1, thread_name_prefix="render") as executor:
        if settings.floor_plan is not None:
            seed = warehouse_seed(settings.seed)
            await asyncio.get_running_loop().run_in_executor(executor, write_floor_plan, settings.floor_plan, seed)
        if settings.bag is None:
            await _live(settings, executor)
        else:
            await _record(settings, settings.bag, executor)


async def _record(settings: SimulatorSettings, bag: Path, executor: Executor) -> None:
    namespaced = settings.robots > 1 and not one_each(bag)
    loop = asyncio.get_running_loop()
    fleet = await loop.run_in_executor(executor, lambda: list(robots(settings, namespaced=namespaced)))
    instants = settings.frames if settings.seconds is None else max(1, round(settings.seconds * settings.hz))
    await write_bags(bag, fleet, hz=settings.hz, instants=instants, executor=executor)
    log.info("wrote %d robots, %g s each: %s", len(fleet), instants / settings.hz, bag)


async def _live(settings: SimulatorSettings, executor: Executor) -> None:
    live: list[LiveRobot] = []
    async with AsyncExitStack() as stack:
        masters = await _masters(settings, stack)
        fleet = robots(settings, namespaced=settings.ros_master is not None and settings.robots > 1)
        if settings.prerender:
            fleet = iter(await prerender(fleet, executor))
        try:
            await _drive(settings, masters, fleet, live, executor)
        finally:
            if settings.summary:
                sys.stdout.write(json.dumps({"sent": {each.robot.name: each.sent for each in live}}) + "\n")
                sys.stdout.flush()


async def _masters(settings: SimulatorSettings, stack: AsyncExitStack) -> Sequence[str]:
    """Return the master of each robot, started here unless there is a real one."""
    if settings.ros_master is not None:
        return [settings.ros_master] * settings.robots
    uris = []
    for number in range(settings.robots):
        port = settings.master_port and settings.master_port + number
        try:
            master = await stack.enter_async_context(RosMaster(host=settings.ros_host, port=port))
        except OSError as error:
            raise MasterError(
                f"--master-port: no ROS master can listen on {settings.ros_host}:{port}: {error}"
            ) from error
        uris.append(master.uri)
    return uris


async def _drive(
    settings: SimulatorSettings,
    masters: Sequence[str],
    fleet: Iterator[Robot],
    live: list[LiveRobot],
    executor: Executor,
) -> None:
    loop = asyncio.get_running_loop()
    begun_s = None
    if settings.changes_per_minute:  # robots that share a changing world share its time
        fleet = iter(await loop.run_in_executor(executor, list, fleet))
        begun_s = loop.time()
    async with TaskScope() as scope:
        for number, master in enumerate(masters):
            robot = await loop.run_in_executor(executor, next, fleet)
            node = Node(f"/simulated_{robot.name}_{os.getpid()}", master_uri=master, host=settings.ros_host)
            live.append(LiveRobot(robot, settings.hz, number / settings.robots / settings.hz, begun_s))
            scope.start(_at(node, live[-1], executor), robot.name)
            log.info("robot %s publishes %d topics at %s", robot.name, len(robot.topics), master)
        await (asyncio.Event().wait() if settings.seconds is None else asyncio.sleep(settings.seconds))


async def _at(node: Node, live: LiveRobot, executor: Executor) -> None:
    """Drive a robot; when stopped, all robots unregister at the same time."""
    async with node:
        await live.run(node, executor)
