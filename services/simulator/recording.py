"""ROS 1 bags of simulated robots."""

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer
from rosbags.rosbag1.writer import WriterError

from gateway.ros1.messages import message_type
from services.simulator.errors import BagError
from services.simulator.robot import Robot
from services.simulator.topics import Topic

ROBOT: Final = "{robot}"
"""In a bag's name it stands for a robot's: each then has a bag of its own."""
UNFINISHED: Final = ".active"
"""What rosbag, too, puts behind the name of a bag that is still being written."""


def one_each(bag: Path) -> bool:
    """Whether each robot has a bag of its own."""
    return ROBOT in bag.name


class Recording:
    """The bags of some robots. `close` makes what was written whole, after an interruption too."""

    def __init__(self, bag: Path) -> None:
        self._bag = bag
        self._writers: dict[Path, Writer] = {}
        self._begun: set[Path] = set()
        self._connections: dict[tuple[str, Topic], tuple[Path, Connection]] = {}

    def open(self, robots: Iterable[Robot]) -> None:
        """Begin the bags of these robots.

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
        """Write the indices and give the bags their names. A bag of which nothing was written is none.

        Raises:
            BagError: they cannot be written; what there is of them keeps its unfinished name.
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
                raise BagError(f"--bag {path}: is there already")
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
