"""Settings of the simulated robots."""

import os
import re
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, Field, ValidationInfo, model_validator

from gateway.ros1.addresses import validate_host, validate_master_uri
from services.option_names import given_as_options
from services.simulator.localisation import Lost
from services.simulator.topics import SimulatedStream


def master_uri() -> str | None:
    """Return ROS_MASTER_URI, if set: the existing master to register at."""
    return os.environ.get("ROS_MASTER_URI") or None


def _named(bag: Path | None) -> Path | None:
    """Reject a bag name with a placeholder other than {robot}."""
    if bag is not None and (strange := re.findall(r"\{(?!robot\}).*?\}", bag.name)):
        raise ValueError(f"unknown placeholder {strange[0]}; use {{robot}}")
    return bag


def _described(path: Path | None) -> Path | None:
    if path is not None and path.suffix not in (".yaml", ".yml"):
        raise ValueError("the name of a floor plan must end in .yaml")
    return path


def _lost(text: str) -> str:
    Lost.parse(text)
    return text


LostText = Annotated[str, AfterValidator(_lost)]


class SimulatorSettings(BaseModel):
    """Publish the sensors of simulated robots, in rendered warehouses, on a ROS 1 graph or into bags.

    A robot has a colour and depth camera (/camera/..., as RealSense's driver names it), a spinning lidar
    (/velodyne_points), /tf and /tf_static; all that is measured at an instant has the same stamp. Only what somebody
    subscribes to is rendered.

    Each robot has a ROS master of its own, as on a real one. At a real master (--ros-master, or ROS_MASTER_URI) and in
    a bag several robots share the topics, each under its own name: /r1/camera/color/image_raw, /r1/tf.

    --bag needs no ROS master and waits for nothing: stamps are as --hz says, from midnight UTC, 1 January 2026. A bag
    that is interrupted is whole as far as it goes.
    """

    robots: Annotated[int, Field(ge=1, le=100, description="number of robots, named r1, r2, ...")] = 1
    hz: Annotated[float, Field(ge=0.001, le=60, description="measurements per second and robot")] = 2.0
    streams: Annotated[
        list[SimulatedStream], Field(min_length=1, description="what the robots publish besides transforms")
    ] = list(SimulatedStream)
    width: Annotated[int, Field(ge=16, le=4096, description="width of images in pixels")] = 640
    height: Annotated[int, Field(ge=16, le=4096, description="height of images in pixels")] = 480
    align_depth: Annotated[
        bool,
        Field(description="register depth to colour; otherwise it has its own position, field of view and size"),
    ] = True
    depth_encoding: Annotated[
        Literal["16UC1", "32FC1"], Field(description="depth in whole millimetres, or in metres")
    ] = "16UC1"
    depth_width: Annotated[int, Field(ge=16, le=4096, description="width of unregistered depth in pixels")] = 848
    depth_height: Annotated[int, Field(ge=16, le=4096, description="height of unregistered depth in pixels")] = 480
    frames: Annotated[
        int, Field(ge=1, le=10_000, description="measurements per drive, which repeats after the last")
    ] = 120
    seed: Annotated[int, Field(ge=0, description="seed of the warehouses; warehouse n has seed + n")] = 0
    warehouses: Annotated[
        int, Field(ge=1, le=100, description="number of warehouses; with more robots, some share one")
    ] = 3
    changes_per_minute: Annotated[
        float,
        Field(
            ge=0,
            le=20,
            description="changes of each warehouse per minute, at most: forklifts drive, pallets and boxes are"
            " taken away, brought and moved",
        ),
    ] = 0.0
    drift_m: Annotated[
        float,
        Field(
            ge=0, le=10, description="how far robots' localisation is off, 1 standard deviation in metres of x and y"
        ),
    ] = 0.0
    drift_deg: Annotated[
        float, Field(ge=0, le=90, description="how far their headings are off, 1 standard deviation in degrees")
    ] = 0.0
    drift_s: Annotated[
        float,
        Field(ge=1, le=86_400, description="time constant of both: in which errors become other ones, in seconds"),
    ] = 30.0
    lost: Annotated[
        list[LostText],
        Field(
            max_length=1_000,
            description="robots that are lost, and when, in seconds since the start, such as r1=60-80,r2=90-95",
        ),
    ] = []
    lost_m: Annotated[
        float, Field(gt=0, le=1_000, description="how far away a lost robot takes itself to be, in metres")
    ] = 3.0
    prerender: Annotated[
        bool, Field(description="render everything before the start instead of on first subscription")
    ] = False
    memory_mib: Annotated[
        int, Field(ge=1, description="memory for rendered measurements; the rest is rendered again")
    ] = 512
    seconds: Annotated[
        float | None,
        Field(gt=0, le=31_536_000, description="stop after this time; by default a bag holds one round of the drive"),
    ] = None
    bag: Annotated[
        Path | None,
        AfterValidator(_named),
        Field(description="write this ROS 1 bag instead of publishing; {robot} in its name makes one per robot"),
    ] = None
    floor_plan: Annotated[
        Path | None,
        AfterValidator(_described),
        Field(description="also write the first warehouse's floor plan for map_server: this YAML and a PGM beside it"),
    ] = None
    ros_master: Annotated[str, AfterValidator(validate_master_uri)] | None = Field(
        default_factory=master_uri,
        validate_default=True,
        description="URI of an existing ROS master to register at; by default ROS_MASTER_URI",
    )
    master_port: Annotated[
        int,
        Field(
            ge=0,
            le=65_435,
            description="port of the first robot's ROS master; the others use the next ports; 0 for free ones",
        ),
    ] = 11_311
    ros_host: Annotated[
        str,
        AfterValidator(validate_host),
        Field(description="name or address at which ROS nodes reach this machine"),
    ] = "127.0.0.1"
    summary: Annotated[
        bool, Field(description="at the end, print how often each robot published, as one JSON object")
    ] = False

    @model_validator(mode="after")
    def _is_a_bag_or_live(self, info: ValidationInfo) -> Self:
        options = given_as_options(self, info)
        if self.bag is not None and self.ros_master is not None and "ros_master" in options:
            raise ValueError("--bag needs no ROS master: leave out --ros-master")
        if self.bag is not None and self.summary and "summary" in options:
            raise ValueError("--summary counts what is published live: leave it out with --bag")
        return self

    @model_validator(mode="after")
    def _what_changes_is_not_rendered_before(self) -> Self:
        if self.prerender and self.changes_per_minute:
            raise ValueError("--prerender renders a world that stands still: leave it out with --changes-per-minute")
        return self

    @model_validator(mode="after")
    def _lost_robots_are_there(self) -> Self:
        names = {f"r{number + 1}" for number in range(self.robots)}
        if strange := [each.robot for each in self.times_lost if each.robot not in names]:
            raise ValueError(
                f"--lost: there is no robot {strange[0]}; with --robots {self.robots} the last is r{self.robots}"
            )
        return self

    @property
    def times_lost(self) -> list[Lost]:
        """When which robot is lost."""
        return [Lost.parse(each, self.lost_m) for each in self.lost]
