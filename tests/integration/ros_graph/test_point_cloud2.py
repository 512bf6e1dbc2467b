"""Clouds with a wrong layout: the gateway finds the points that ROS's own sensor_msgs.point_cloud2 finds."""

import json
import subprocess
from typing import Any

import numpy as np
import pytest

from gateway.ros1.messages import new_message
from gateway.ros1.tcpros.subscriber import Message
from schemas.points import PointCloud
from tests.gateway.sensing import point_cloud
from tests.gateway.to_bus.translators.translating import translated
from tests.integration.peers.ros import PEERS, SYSTEM_PYTHON

SCRIPT = PEERS / "point_cloud2_reader.py"
X_AND_RING = np.dtype({"names": ["x", "ring"], "formats": ["<f4", "<u2"], "offsets": [0, 4], "itemsize": 8})


FIELDS = [
    new_message("sensor_msgs/PointField", name="x", offset=0, datatype=7, count=1),
    new_message("sensor_msgs/PointField", name="ring", offset=4, datatype=4, count=1),
]


def points(count: int) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
    """Return the bytes of so many points, each of its own."""
    made = np.zeros(count, X_AND_RING)
    made["x"], made["ring"] = np.arange(count) * 1.5, np.arange(count) + 100
    return made.view(np.uint8)


def cloud(**layout: Any) -> Message:
    return point_cloud(fields=FIELDS, **layout)


CLOUDS = {
    "the first row_step of two joined clouds": cloud(height=1, width=6, row_step=24, data=points(6)),
    "row_step is the width": cloud(height=1, width=6, row_step=6, data=points(6)),
    "no row_step": cloud(height=1, width=6, row_step=0, data=points(6)),
    "spare points behind": cloud(height=1, width=4, row_step=48, data=points(6)[:-3]),
    "row_step of the points, spare ones behind": cloud(height=1, width=4, row_step=32, data=points(6)),
    "nothing hit, and a buffer of it": cloud(height=1, width=0, row_step=0, data=points(6)),
    "rows with spare bytes behind": cloud(height=2, width=2, row_step=24, data=points(8)),
    "rows whose last one lacks its padding": cloud(height=2, width=2, row_step=24, data=points(5)),
}


def read_by_ros(clouds: list[Message]) -> list[list[list[float]]]:
    lines = "\n".join(bytes(sent.data).hex() for sent in clouds)
    said = subprocess.run(
        [SYSTEM_PYTHON, str(SCRIPT)], input=lines, capture_output=True, text=True, timeout=60, check=True
    )
    return [json.loads(line) for line in said.stdout.splitlines()]


def read_here(sent: Message) -> list[list[float]]:
    made = translated(PointCloud, "lidar/points", sent, repaired=True)
    found = np.ndarray((made.height, made.width), X_AND_RING, made.data, strides=(made.row_step, made.point_step))
    return [list(point) for point in found.reshape(-1).tolist()]


@pytest.mark.usefixtures("ros_installed")
def test_the_points_are_those_that_ros_reads() -> None:
    for name, sent, theirs in zip(CLOUDS, CLOUDS.values(), read_by_ros(list(CLOUDS.values())), strict=True):
        assert read_here(sent) == theirs, name
