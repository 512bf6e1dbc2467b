"""Settings of the simulated robots."""

import os
from typing import Annotated

from pydantic import BaseModel, Field


def master_uri() -> str | None:
    """Return ROS_MASTER_URI, if set: the real master to register at."""
    return os.environ.get("ROS_MASTER_URI") or None


class SimulatorSettings(BaseModel):
    """Publish the cameras of robots that are not there, in rendered warehouses, on a ROS 1 graph.

    Each robot has a ROS master of its own, as on a real one, and publishes /camera/color/image_raw. At a real master
    (--ros-master, or ROS_MASTER_URI) several robots share it, each under its own name: /r1/camera/color/image_raw.
    """

    robots: Annotated[int, Field(ge=1, le=100, description="how many robots; they are called r1, r2, ...")] = 1
    hz: Annotated[float, Field(gt=0, le=60, description="images per second and robot")] = 2.0
    width: Annotated[int, Field(ge=16, le=4096, description="pixels in a row")] = 640
    height: Annotated[int, Field(ge=16, le=4096, description="rows of an image")] = 480
    frames: Annotated[
        int, Field(ge=1, le=10_000, description="images of a robot's drive; it starts over after the last")
    ] = 120
    seed: Annotated[int, Field(ge=0, description="robot n drives through the warehouse of seed + n")] = 0
    ros_master: Annotated[
        str | None,
        Field(default_factory=master_uri, description="a real master to register at; ROS_MASTER_URI unless given"),
    ]
    master_port: Annotated[
        int,
        Field(
            ge=0, le=65_435, description="the first robot's own master listens here, the next ones' on the next ports"
        ),
    ] = 11_311
    ros_host: Annotated[str, Field(description="name or address at which ROS nodes reach this machine")] = "127.0.0.1"
    summary: Annotated[bool, Field(description="at the end, print the counts as one JSON object")] = False
