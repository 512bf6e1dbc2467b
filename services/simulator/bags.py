"""Writes ROS 1 bags of simulated robots, without ROS and faster than real time."""

import asyncio
import shutil
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer
from rosbags.rosbag1.writer import WriterError

from gateway.ros1.messages import message_type
from gateway.ros1.tasks import to_the_end
from services.simulator.errors import BagError
from services.simulator.progress_bars import bar
from services.simulator.robot import Robot
from services.simulator.topics import Topic

ROBOT: Final = "{robot}"
"""The placeholder for a robot's name in a bag's name: each robot then has its own bag."""
UNFINISHED: Final = ".active"
"""The suffix of a bag that is still being written, as in rosbag."""


def one_each(bag: Path) -> bool:
    """Whether each robot has its own bag."""
    return ROBOT in bag.name


class Recording:
    """The bags of some robots. `close` completes what was written, even after an interruption."""

    def __init__(self, bag: Path) -> None:
        self._bag = bag
        self._writers: dict[Path, Writer] = {}
        self._begun: set[Path] = set()
        self._connections: dict[tuple[str, Topic], tuple[Path, Connection]] = {}

    def open(self, robots: Iterable[Robot]) -> None:
        """Open the bags of these robots.

        Raises:
            BagError: a bag is there already or cannot be written; then none is left behind.
        """
        try:
            for robot in robots:
                self._add(robot)
        except BagError:
            for path, writer in self._writers.items():
                _give_up(writer, path)
            self._writers.clear()
            raise

    def write(self, robot: Robot, stamp: int, messages: Iterable[tuple[Topic, bytes]]) -> None:
        """Add messages as received at their stamp.

        Raises:
            BagError: they cannot be written.
        """
        with self._explained():
            for topic, message in messages:
                path, connection = self._connections[robot.name, topic]
                self._writers[path].write(connection, stamp, message)
                self._begun.add(path)

    def close(self) -> None:
        """Write the indices and give the bags their final names. Empty bags are removed.

        Raises:
            BagError: they cannot be written; unfinished bags keep their unfinished names.
        """
        with self._explained(), ExitStack() as all_of_them:
            for path, writer in self._writers.items():
                all_of_them.callback(_finish if path in self._begun else _give_up, writer, path)

    def _add(self, robot: Robot) -> None:
        path = self._bag.with_name(self._bag.name.replace(ROBOT, robot.name))
        writer = self._writers.get(path) or self._open(path)
        for topic in robot.topics:
            kind = message_type(topic.type)
            connection = writer.add_connection(
                robot.path(topic),
                topic.type.replace("/", "/msg/"),
                msgdef=kind.definition,
                md5sum=kind.md5sum,
                callerid=f"/simulated_{robot.name}",
                latching=int(topic.latched),
            )
            self._connections[robot.name, topic] = path, connection

    def _open(self, path: Path) -> Writer:
        with self._explained():
            if path.exists():
                raise BagError(f"--bag {path}: already exists")
            writer = Writer(path.with_name(path.name + UNFINISHED))
            writer.open()
        self._writers[path] = writer
        return writer

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except WriterError as error:
            raise BagError(f"--bag {self._bag}: {error}") from error
        except OSError as error:
            raise BagError(f"--bag {self._bag}: {error.strerror or error}") from error


def _finish(writer: Writer, path: Path) -> None:
    try:
        writer.close()
    except OSError:
        with suppress(OSError):
            writer.abort()
        raise
    writer.path.rename(path)


def _give_up(writer: Writer, _path: Path) -> None:
    writer.abort()
    writer.path.unlink(missing_ok=True)


START_NS: Final = 1_767_225_600_000_000_000
"""Midnight UTC, 1 January 2026. Every bag begins then, so that the same settings write the same bag."""
SECOND_NS: Final = 1_000_000_000


async def write_bags(bag: Path, robots: Sequence[Robot], *, hz: float, instants: int, executor: Executor) -> None:
    """Write this many instants of every robot. If interrupted, the bags end there. `executor` measures.

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
    """Raise if the bag would not fit.

    Raises:
        BagError: there is no folder for the bag, or less room in it than `needed` bytes.
    """
    try:
        free = shutil.disk_usage(bag.parent).free
    except OSError as error:
        raise BagError(f"--bag {bag}: {bag.parent}: {error.strerror}") from error
    if needed > free:
        raise BagError(
            f"--bag {bag}: needs about {_readable(needed)}, but {_readable(free)} are free there:"
            " use fewer --robots, --seconds or --streams"
        )


def _readable(size: int) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"


def _turns(robots: Sequence[Robot], hz: float, instants: int) -> Iterator[tuple[Robot, int, int]]:
    """Yield the robot that measures next, the number of its instant, and its time: the robots take turns."""
    for turn in range(instants * len(robots)):
        number, which = divmod(turn, len(robots))
        yield robots[which], number, START_NS + round(turn * SECOND_NS / hz / len(robots))


def _messages(robot: Robot, number: int, stamp: int) -> list[tuple[Topic, bytes]]:
    wanted = [topic for topic in robot.topics if number == 0 or not topic.latched]
    return robot.publish(number, wanted, lambda: stamp, (stamp - START_NS) / SECOND_NS)


def _bytes_of_instant(robot: Robot) -> int:
    return sum(len(message) for _, message in _messages(robot, 0, START_NS))
