"""A fleet's drive written to bags: without ROS, as fast as it can be made, with the stamps of the asked rate."""

import asyncio
import shutil
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Final

from gateway.ros1.tasks import to_the_end
from services.simulator.bars import bar
from services.simulator.errors import BagError
from services.simulator.recording import Recording
from services.simulator.robot import Robot
from services.simulator.topics import Topic

START_NS: Final = 1_767_225_600_000_000_000
"""Midnight UTC, 1 January 2026. Every bag begins then, so that the same settings write the same bag."""
SECOND_NS: Final = 1_000_000_000


async def write_bags(bag: Path, robots: Sequence[Robot], *, hz: float, instants: int, executor: Executor) -> None:
    """Write that many instants of every robot. Interrupted, the bags end there. `executor` measures.

    Raises:
        BagError: a bag cannot be written, or would not fit.
    """
    loop = asyncio.get_running_loop()
    size = await loop.run_in_executor(executor, _bytes_of_instant, robots[0])
    recording = Recording(bag)
    with ThreadPoolExecutor(1, thread_name_prefix="bag") as writing:

        async def close() -> None:
            await loop.run_in_executor(writing, recording.close)

        try:
            await loop.run_in_executor(writing, check_room, bag, size * instants * len(robots))
            await loop.run_in_executor(writing, recording.open, robots)
            with bar(f"writing {bag.name}", instants * len(robots)) as done:
                for robot, number, stamp in _turns(robots, hz, instants):
                    messages = await loop.run_in_executor(executor, _messages, robot, number, stamp)
                    await loop.run_in_executor(writing, recording.write, robot, stamp, messages)
                    done()
        finally:
            await to_the_end(close())


def check_room(bag: Path, needed: int) -> None:
    """Refuse what would not fit.

    Raises:
        BagError: there is no folder for the bag, or less room in it than `needed` bytes.
    """
    try:
        free = shutil.disk_usage(bag.parent).free
    except OSError as error:
        raise BagError(f"--bag {bag}: {bag.parent}: {error.strerror}") from error
    if needed > free:
        raise BagError(
            f"--bag {bag}: needs about {_readable(needed)} of the {_readable(free)} that are free there:"
            " fewer --robots, --seconds or --streams need less"
        )


def _readable(size: int) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"


def _turns(robots: Sequence[Robot], hz: float, instants: int) -> Iterator[tuple[Robot, int, int]]:
    """Yield who measures next, its how manieth instant that is, and when: the robots take turns."""
    for turn in range(instants * len(robots)):
        number, which = divmod(turn, len(robots))
        yield robots[which], number, START_NS + round(turn * SECOND_NS / hz / len(robots))


def _messages(robot: Robot, number: int, stamp: int) -> list[tuple[Topic, bytes]]:
    wanted = [topic for topic in robot.topics if number == 0 or not topic.latched]
    return robot.publish(number, wanted, lambda: stamp)


def _bytes_of_instant(robot: Robot) -> int:
    return sum(len(message) for _, message in _messages(robot, 0, START_NS))
