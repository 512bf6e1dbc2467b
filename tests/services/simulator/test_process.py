import json
import logging
import re
import socket
from pathlib import Path

import pytest
from rosbags.rosbag1 import Reader

from services.simulator.errors import MasterError
from services.simulator.process import run
from services.simulator.settings import SimulatorSettings
from services.simulator.topics import Stream
from services.toolbox.demo.children import free_ports

SMALL = SimulatorSettings(
    robots=2, hz=20, width=64, height=48, frames=2, warehouses=1, streams=[Stream.COLOR], ros_master=None
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
