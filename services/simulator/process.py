"""The simulator process: masters where none is given, a node and a camera per robot."""

import asyncio
import json
import logging
import os
import sys
from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import AsyncExitStack

from gateway.ros1.node import Node
from gateway.ros1.rosmaster import RosMaster
from services.simulator.film import Film
from services.simulator.robot import TOPIC, Robot
from services.simulator.settings import SimulatorSettings
from services.simulator.world import Camera

log = logging.getLogger(__name__)

FIELD_OF_VIEW_RAD = 1.2


class MasterError(Exception):
    """A robot's own ROS master cannot be started."""


async def run(settings: SimulatorSettings) -> None:
    """Drive the robots until cancelled.

    Raises:
        MasterError: a robot's own ROS master cannot listen where it should.
    """
    robots: list[Robot] = []
    try:
        with ThreadPoolExecutor(1, thread_name_prefix="render") as executor:
            async with AsyncExitStack() as stack:
                masters = await _masters(settings, stack)
                await _drive(settings, masters, robots, executor)
    finally:
        if settings.summary:
            sys.stdout.write(json.dumps({"sent": {robot.name: robot.sent for robot in robots}}) + "\n")
            sys.stdout.flush()


async def _masters(settings: SimulatorSettings, stack: AsyncExitStack) -> Sequence[str]:
    """Return the master of each robot, started here unless there is a real one."""
    if settings.ros_master is not None:
        return [settings.ros_master] * settings.robots
    uris = []
    for port in range(settings.master_port, settings.master_port + settings.robots):
        try:
            master = await stack.enter_async_context(RosMaster(host=settings.ros_host, port=port))
        except OSError as error:
            raise MasterError(
                f"--master-port: no ROS master can listen on {settings.ros_host}:{port}: {error}"
            ) from error
        uris.append(master.uri)
    return uris


async def _drive(settings: SimulatorSettings, masters: Sequence[str], robots: list[Robot], executor: Executor) -> None:
    camera = Camera.with_field_of_view(settings.width, settings.height, FIELD_OF_VIEW_RAD)
    async with AsyncExitStack() as stack, asyncio.TaskGroup() as group:
        for number, master in enumerate(masters, 1):
            name = f"r{number}"
            shared = settings.ros_master is not None and settings.robots > 1
            topic = f"/{name}/{TOPIC}" if shared else f"/{TOPIC}"
            node = await stack.enter_async_context(
                Node(f"/simulated_{name}_{os.getpid()}", master_uri=master, host=settings.ros_host)
            )
            loop = asyncio.get_running_loop()
            film = await loop.run_in_executor(executor, Film, settings.seed + number, camera, settings.frames)
            robots.append(Robot(name, topic, film, settings.hz))
            group.create_task(robots[-1].run(node, executor))
            log.info("robot %s publishes %s at %s", name, topic, master)
