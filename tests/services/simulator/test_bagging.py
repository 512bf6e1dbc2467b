import asyncio
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest
from rosbags.rosbag1 import Reader

from services.simulator.bags import START_NS, check_room, write_bags
from services.simulator.errors import BagError
from services.simulator.localisation import Drift, Localisation, Lost
from services.simulator.robot import Robot
from services.simulator.topics import SimulatedStream, topics
from tests.services.simulator.small import film, robot
from tests.waiting import until


def names_in(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def bytes_in(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.iterdir())


async def written(bag: Path, robots: list[Robot], instants: int) -> list[tuple[str, int, bytes]]:
    with ThreadPoolExecutor(1) as executor:
        await write_bags(bag, robots, hz=4, instants=instants, executor=executor)
    with Reader(bag) as reader:
        return [(connection.topic, stamp, bytes(data)) for connection, stamp, data in reader.messages()]


async def test_robots_take_turns_at_the_asked_rate_from_a_fixed_time(tmp_path: Path) -> None:
    color = topics([SimulatedStream.COLOR], aligned=True)
    fleet = [Robot(name, f"/{name}", film(), color) for name in ("r1", "r2")]
    found = await written(tmp_path / "out.bag", fleet, 3)
    stamps = {
        name: [stamp - START_NS for topic, stamp, _ in found if topic == f"/{name}/camera/color/image_raw"]
        for name in ("r1", "r2")
    }
    assert stamps == {"r1": [0, 250_000_000, 500_000_000], "r2": [125_000_000, 375_000_000, 625_000_000]}
    assert [topic for topic, _, _ in found].count("/r1/tf_static") == 1
    assert [stamp for _, stamp, _ in found] == sorted(stamp for _, stamp, _ in found)


async def test_the_same_robots_write_the_same_bag(tmp_path: Path) -> None:
    bags = [tmp_path / name for name in ("one.bag", "other.bag")]
    for bag in bags:
        await written(bag, [robot()], 2)
    assert bags[0].read_bytes() == bags[1].read_bytes()


async def test_localisation_errs_in_a_bag_as_it_does_so_long_after_the_start(tmp_path: Path) -> None:
    error = Localisation(Drift(0.1), [Lost("r1", 0.4, 0.6)])
    which = Robot("r1", "", film(), topics([SimulatedStream.COLOR], aligned=True), localisation=error)
    found = await written(tmp_path / "out.bag", [which], 4)
    said = [data for topic, _, data in found if topic == "/tf"]
    for number, data in enumerate(said):
        wanted = [topic for topic in which.topics if topic.name == "tf"]
        stamp = START_NS + number * 250_000_000
        ((_, expected),) = which.publish(number, wanted, partial(int, stamp), number / 4)
        assert data == expected
    assert len(said) == 4


async def test_an_interrupted_bag_is_whole_as_far_as_it_goes(tmp_path: Path) -> None:
    bag = tmp_path / "out.bag"
    with ThreadPoolExecutor(1) as executor:
        writing = asyncio.create_task(write_bags(bag, [robot()], hz=4, instants=1_000, executor=executor))
        await until(lambda: writing.done() or bytes_in(tmp_path) > 1_000_000, "a part is written")
        assert not writing.done()
        writing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await writing
    with Reader(bag) as reader:
        assert 0 < reader.message_count < 9_000
        assert len(list(reader.messages())) == reader.message_count
    assert names_in(tmp_path) == ["out.bag"]


async def test_what_would_not_fit_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with (
        ThreadPoolExecutor(1) as executor,
        pytest.raises(BagError, match=r"out[.]bag: needs about \d[\d.]+ GB, but [\d.]+ [GM]B are free"),
    ):
        await write_bags(tmp_path / "out.bag", [robot()], hz=4, instants=10**12, executor=executor)
    assert names_in(tmp_path) == []


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    check_room(tmp_path / "out.bag", 1)
    with pytest.raises(BagError, match=r"--bag .*nowhere/out[.]bag: .*nowhere: No such file or directory"):
        check_room(tmp_path / "nowhere" / "out.bag", 1)
