"""Names, keys and other texts, which come out of other peers' messages too."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from bus.errors import BusError
from bus.keys import key_expression, single_key
from gateway.ros1.addresses import parse_rosrpc, validate_host, validate_master_uri
from gateway.ros1.errors import InvalidNameError, MessageError
from gateway.ros1.msg.definition import parse
from gateway.ros1.names import resolve, validate_global, validate_type
from schemas.consumer_keys import parse_budget, parse_wanted
from schemas.errors import SchemaError
from schemas.keys import CameraKey, RobotStreamKey, parse_robot, parse_service, parse_stream, sensor_key
from schemas.worker_keys import parse_serves, parse_worker, parse_worker_alive
from tests.fuzz.target import Target

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

KEYS = [
    b"fleet/r1/front/color",
    b"fleet/r1/front/color/alive",
    b"fleet/r1/front/color/wanted/clock/w1",
    b"fleet/r1/service/arm/stop",
    b"fleet/r1/alive",
    b"fleet/r1/ros/a/b",
    b"workers/detector/w1/1.5/-/alive",
    b"workers/detector/w1/serves/r1/front",
    b"fleet/r1/front/budget/w1",
    b"front/depth_info",
    b"tf_static",
]
NAMES = [b"/ns/camera/image_raw", b"relative", b"~private", b"sensor_msgs/Image", b"http://robot:11311/", b"[::1]"]
SERVICES = [b"rosrpc://robot:40001", b"rosrpc://[::1]:1/"]

DEFINITIONS = [b"uint8 A=5 # five\nHeader header\na/B[3] some\n\nstring S= a # b\ntime[] at", b"float64[9] K"]


def feed(parse: Callable[[str], object], data: bytes, _rng: Random) -> None:
    parse(data.decode(errors="surrogateescape"))


def target(name: str, seeds: list[bytes], parse: Callable[[str], object], error: type[Exception]) -> Target:
    return Target(name, seeds, partial(feed, parse), (error,))


TARGETS = [
    target("stream's key", KEYS, parse_stream, SchemaError),
    target("robot's key", KEYS, parse_robot, SchemaError),
    target("worker's key", KEYS, parse_worker, SchemaError),
    target("worker's presence", KEYS, parse_worker_alive, SchemaError),
    target("key of a camera taken over", KEYS, parse_serves, SchemaError),
    target("key of budgets", KEYS, parse_budget, SchemaError),
    target("sensor's key", KEYS, partial(sensor_key, "r1"), SchemaError),
    target("consumer's key", KEYS, parse_wanted, SchemaError),
    target("service's key", KEYS, parse_service, SchemaError),
    target("camera", KEYS, partial(CameraKey, "r1"), SchemaError),
    target("robot's stream", KEYS, partial(RobotStreamKey, "r1"), SchemaError),
    target("key", [*KEYS, b"a/**/b*"], key_expression, BusError),
    target("single key", KEYS, single_key, BusError),
    target("ROS name", NAMES, partial(resolve, node="/ns/ours"), InvalidNameError),
    target("global ROS name", NAMES, validate_global, InvalidNameError),
    target("ROS type", NAMES, validate_type, InvalidNameError),
    target("master's address", NAMES, validate_master_uri, InvalidNameError),
    target("service's address", SERVICES, parse_rosrpc, InvalidNameError),
    target("host", NAMES, validate_host, InvalidNameError),
    target("message definition", DEFINITIONS, partial(parse, "a/B"), MessageError),
]
