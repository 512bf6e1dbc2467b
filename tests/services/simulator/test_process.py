import json
import logging
import re
import socket
from pathlib import Path

import pytest
from rosbags.rosbag1 import Reader

from services.simulator.bags import START_NS
from services.simulator.errors import MasterError
from services.simulator.fleet import robots
from services.simulator.process import run
from services.simulator.settings import SimulatorSettings
from services.simulator.topics import Content, SimulatedStream
from services.toolbox.demo.children import free_ports

SMALL = SimulatorSettings(
    robots=2, hz=20, width=64, height=48, frames=2, warehouses=1, streams=[SimulatedStream.COLOR], ros_master=None
)


async def test_it_stops_by_itself_and_adds_up(capsys: pytest.CaptureFixture[str]) -> None:
    changes = {"seconds": 0.1, "summary": True, "prerender": True, "master_port": free_ports(2)}
    await run(SMALL.model_copy(update=changes))
    said = capsys.readouterr()
    assert json.loads(said.out) == {"sent": {"r1": 0, "r2": 0}}
    assert "rendering: 2 of 2" in said.err


async def test_a_master_that_cannot_listen_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(MasterError, match=f"--master-port: no ROS master can listen on 127.0.0.1:{port}"):
            await run(SMALL.model_copy(update={"master_port": port}))


async def test_any_port_is_a_port_of_its_own_for_each_master(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, logger="services.simulator"):
        await run(SMALL.model_copy(update={"robots": 3, "seconds": 0.1, "master_port": 0}))
    ports = [int(port) for port in re.findall(r"publishes .* at http://127\.0\.0\.1:(\d+)", caplog.text)]
    assert len(set(ports)) == 3
    assert min(ports) > 1023


async def test_bags_of_a_changing_world_show_it_as_it_is_at_their_stamps(tmp_path: Path) -> None:
    changed = {"changes_per_minute": 20, "seconds": 60, "hz": 0.2, "streams": [SimulatedStream.LIDAR], "warehouses": 1}
    bags = [tmp_path / name for name in ("one.bag", "other.bag", "still.bag")]
    for bag, per_minute in zip(bags, (20, 20, 0), strict=True):
        await run(SMALL.model_copy(update={**changed, "bag": bag, "changes_per_minute": per_minute}))
    one, other, still = ([data for topic, data in _messages(bag) if "velodyne" in topic] for bag in bags)
    assert one == other
    assert len(one) == len(still) == 24
    assert one[0] == still[0]
    assert one[-1] != still[-1]
    settings = SMALL.model_copy(update=changed)
    (first, second) = robots(settings, namespaced=True)
    assert first.film is second.film
    topic = next(topic for topic in second.topics if topic.content is Content.LIDAR)
    ((_, message),) = second.publish(11, [topic], lambda: START_NS + 57_500_000_000, 57.5)
    assert message == one[-1]


async def test_robots_of_a_changing_world_start_together(caplog: pytest.LogCaptureFixture) -> None:
    changes = {"changes_per_minute": 5, "seconds": 0.1, "master_port": 0}
    with caplog.at_level(logging.INFO, logger="services.simulator"):
        await run(SMALL.model_copy(update=changes))
    assert len(re.findall(r"robot r\d publishes", caplog.text)) == 2


def _messages(bag: Path) -> list[tuple[str, bytes]]:
    with Reader(bag) as reader:
        return [(connection.topic, bytes(data)) for connection, _, data in reader.messages()]


@pytest.mark.parametrize(
    ("changes", "name", "topics", "instants"),
    [
        ({"robots": 1}, "out.bag", {"/camera/color/image_raw"}, 2),
        ({"seconds": 0.16}, "out.bag", {"/r1/camera/color/image_raw", "/r2/camera/color/image_raw"}, 3),
        ({"seconds": 0.01}, "{robot}.bag", {"/camera/color/image_raw"}, 1),
    ],
)
async def test_a_bag_has_a_round_or_as_long_as_asked(
    tmp_path: Path, changes: dict[str, object], name: str, topics: set[str], instants: int
) -> None:
    await run(SMALL.model_copy(update={**changes, "bag": tmp_path / name}))
    with Reader(tmp_path / name.replace("{robot}", "r1")) as reader:
        found = {connection.topic: connection.msgcount for connection in reader.connections}
    assert {topic: count for topic, count in found.items() if topic.endswith("image_raw")} == dict.fromkeys(
        topics, instants
    )
