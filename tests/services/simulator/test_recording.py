import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from rosbags.interfaces import ConnectionExtRosbag1
from rosbags.rosbag1 import Reader

from gateway.ros1.messages import message_type
from services.simulator.bags import Recording, one_each
from services.simulator.errors import BagError
from services.simulator.robot import Robot
from services.simulator.topics import Topic
from tests.services.simulator.small import film, robot

START = 1_700_000_000_000_000_001


def messages(which: Robot, number: int, stamp: int) -> list[tuple[Topic, bytes]]:
    return which.publish(number, which.topics, lambda: stamp)


def read(bag: Path) -> list[tuple[str, int, bytes]]:
    with Reader(bag) as reader:
        return [(connection.topic, stamp, bytes(data)) for connection, stamp, data in reader.messages()]


def test_a_bag_has_what_was_written_as_it_was_with_its_types(tmp_path: Path) -> None:
    which, bag = robot(), tmp_path / "out.bag"
    recording = Recording(bag)
    recording.open([which])
    for number in range(2):
        recording.write(which, START + number, messages(which, number, START + number))
    assert not bag.exists()
    recording.close()
    assert [path.name for path in tmp_path.iterdir()] == ["out.bag"]
    expected = [
        (which.path(topic), START + number, data)
        for number in range(2)
        for topic, data in messages(which, number, START + number)
    ]
    assert sorted(read(bag)) == sorted(expected)
    with Reader(bag) as reader:
        for connection in reader.connections:
            kind = message_type(connection.msgtype.replace("/msg/", "/"))
            assert connection.digest == kind.md5sum
            assert connection.msgdef.data == kind.definition
            assert connection.ext == ConnectionExtRosbag1("/simulated_r1", int(connection.topic == "/tf_static"))


def test_robots_share_a_bag_or_have_one_each(tmp_path: Path) -> None:
    first = Robot("r1", "/r1", film(), robot().topics)
    second = Robot("r2", "/r2", film(), robot().topics)
    for name in ("all.bag", "{robot}.bag"):
        recording = Recording(tmp_path / name)
        recording.open([first, second])
        for which in (first, second):
            recording.write(which, START, messages(which, 0, START))
        recording.close()
    assert {path.name for path in tmp_path.iterdir()} == {"all.bag", "r1.bag", "r2.bag"}
    assert {topic.split("/")[1] for topic, _, _ in read(tmp_path / "all.bag")} == {"r1", "r2"}
    assert {topic.split("/")[1] for topic, _, _ in read(tmp_path / "r2.bag")} == {"r2"}
    assert [one_each(Path(name)) for name in ("all.bag", "{robot}.bag", "{robot}/a.bag")] == [False, True, False]


@pytest.mark.parametrize("there", ["out.bag", "out.bag.active"])
def test_what_is_there_is_not_overwritten(tmp_path: Path, there: str) -> None:
    (tmp_path / there).write_bytes(b"mine")
    with pytest.raises(BagError, match=r"out\.bag.*already"):
        Recording(tmp_path / "out.bag").open([robot()])
    assert (tmp_path / there).read_bytes() == b"mine"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_name_that_no_file_can_have_is_said(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"--bag .*too long"):
        Recording(tmp_path / ("a" * 300 + ".bag")).open([robot()])


def test_no_bag_is_left_when_one_of_several_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "r2.bag").touch()
    recording = Recording(tmp_path / "{robot}.bag")
    with pytest.raises(BagError, match="already"):
        recording.open([robot(), Robot("r2", "", film(), robot().topics)])
    recording.close()
    assert [path.name for path in tmp_path.iterdir()] == ["r2.bag"]


def test_a_bag_of_nothing_is_none(tmp_path: Path) -> None:
    recording = Recording(tmp_path / "out.bag")
    recording.close()
    recording.open([robot()])
    recording.close()
    assert list(tmp_path.iterdir()) == []


def test_where_nothing_can_be_written_is_said() -> None:
    with pytest.raises(BagError, match=r"--bag /proc/out[.]bag: "):
        Recording(Path("/proc/out.bag")).open([robot()])


@contextmanager
def small_files() -> Iterator[None]:
    """Let no file grow beyond 100 kB."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_what_cannot_be_written_is_said_and_what_was_keeps_its_unfinished_name(tmp_path: Path) -> None:
    which = robot()
    recording = Recording(tmp_path / "out.bag")
    recording.open([which])
    with small_files():
        with pytest.raises(BagError, match=r"out[.]bag: File too large"):
            recording.write(which, START, [each for _ in range(4) for each in messages(which, 0, START)])
        with pytest.raises(BagError, match=r"out[.]bag: File too large"):
            recording.close()
    assert [path.name for path in tmp_path.iterdir()] == ["out.bag.active"]
