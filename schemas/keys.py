"""Builds and parses keys; only this module and `schemas.worker_keys` do.

`fleet/{robot}/{camera}/{stream}` for a camera's streams, `fleet/{robot}/...` for what belongs to the whole robot. A
chunk is a name (see `schemas.header.Name`).
"""

import re
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Final

import msgspec

from schemas.errors import SchemaError

NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.\-]{0,63}")
SERVICE: Final = re.compile(r"(?:/[A-Za-z0-9_]+)+")
ALIVE: Final = "alive"
WANTED: Final = "wanted"
BUDGET: Final = "budget"

RESERVED: Final = frozenset(
    {"actions", "alerts", ALIVE, "clock", "nearby", "ros", "service", "status", "text", "tf", "tf_static"}
)
"""Chunks with a robot-wide meaning, reserved as camera names."""

TF: Final = "tf"
TF_STATIC: Final = "tf_static"
TEXT: Final = "text"
ROS: Final = "ros"

ROBOT_STREAMS: Final = frozenset({TF, TF_STATIC})
"""Streams that sensors send once per robot."""

ALERTS: Final = "alerts"
ACTIONS: Final = "actions"
NEARBY: Final = "nearby"

ROBOT_RESULTS: Final = frozenset({ALERTS, ACTIONS, NEARBY})
"""Streams sent to a robot, once per robot."""

REMEMBERED: Final = 1 << 16
"""Size of the cache of parsed keys: the same few thousand keys recur."""

NAMED_STREAMS: Final = frozenset({TEXT, ROS})
"""Streams of which there may be any number, each followed by a name of one or more chunks."""

MAX_NAMED: Final = 200

MOST_CAMERAS: Final = 256
"""Of one robot, that monitor and workers follow: none can take the others' room."""


class Stream(StrEnum):
    """The streams of a camera."""

    COLOR = "color"
    DEPTH = "depth"
    INFO = "info"
    DEPTH_INFO = "depth_info"
    POINTS = "points"
    DETECTIONS = "detections"
    CLASSES = "classes"
    OPINION = "opinion"
    OVERLAY_DETECTION = "overlay/detection"
    OVERLAY_SEGMENTATION = "overlay/segmentation"
    DISTANCES = "distances"
    VIEW = "view"
    OBJECTS = "objects"


class CameraKey(msgspec.Struct, frozen=True, order=True, gc=False, cache_hash=True):
    """One camera of one robot.

    Raises:
        SchemaError: a name that cannot be a chunk of a key, or that is reserved.

    >>> str(fleetsight.CameraKey("r1", "front"))
    'r1/front'
    """

    robot: str
    camera: str

    def __post_init__(self) -> None:
        check_name("robot", self.robot)
        check_name("camera", self.camera)
        if self.camera in RESERVED:
            raise SchemaError(f"camera name {self.camera!r} is reserved")

    def __str__(self) -> str:
        return f"{self.robot}/{self.camera}"

    def stream(self, stream: Stream) -> str:
        """Return the key of a stream of this camera."""
        return f"fleet/{self.robot}/{self.camera}/{stream}"

    def alive(self, stream: Stream) -> str:
        """Return the key of the presence token that announces this stream."""
        return f"{self.stream(stream)}/{ALIVE}"


@lru_cache(REMEMBERED)
def camera_key(robot: str, camera: str) -> CameraKey:
    """Return a camera's key; cached, so that names are checked once.

    Raises:
        SchemaError: as CameraKey does.
    """
    return CameraKey(robot, camera)


def check_name(what: str, name: str) -> None:
    """Raise SchemaError unless `name` can be one chunk of a key; `what` is its kind, for the message."""
    if not NAME.fullmatch(name):
        raise SchemaError(
            f"{what} name {name[:80]!r}: use 1 to 64 letters, digits, '_', '-' or '.', a letter or digit first"
        )


def every_stream(stream: Stream) -> str:
    """Return the key expression of a stream of every camera of every robot."""
    return f"fleet/*/*/{stream}"


def every_stream_alive(stream: Stream) -> str:
    """Return the key expression of the presence tokens of a stream of every camera."""
    return f"fleet/*/*/{stream}/{ALIVE}"


def robot_prefix(robot: str) -> str:
    """Return the beginning of all keys of a robot."""
    check_name("robot", robot)
    return f"fleet/{robot}"


def robot_alive(robot: str) -> str:
    """Return the key of the presence token of a robot's gateway."""
    check_name("robot", robot)
    return f"fleet/{robot}/{ALIVE}"


def gateway_status(robot: str) -> str:
    """Return the key of a gateway's GatewayStatus."""
    check_name("robot", robot)
    return f"fleet/{robot}/status"


def robot_clock(robot: str) -> str:
    """Return the key under which a gateway answers with a ClockReading."""
    check_name("robot", robot)
    return f"fleet/{robot}/clock"


def every_service(robot: str) -> str:
    """Return the key expression of a robot's ROS services."""
    check_name("robot", robot)
    return f"fleet/{robot}/service/**"


def service(robot: str, name: str) -> str:
    """Return the key under which a gateway calls a ROS service; `name` is global, such as /front/reset.

    Raises:
        SchemaError: it is no ROS name.
    """
    check_name("robot", robot)
    if len(name) > MAX_NAMED or not SERVICE.fullmatch(name):
        raise SchemaError(f"not the name of a ROS service: {name[:MAX_NAMED]!r}; one looks like /front/reset")
    return f"fleet/{robot}/service{name}"


def parse_service(key: str) -> tuple[str, str]:
    """Return the robot and the ROS service of a key.

    Raises:
        SchemaError: the key is not a service's.
    """
    match key.split("/", 3):
        case ["fleet", robot, "service", name] if service(robot, f"/{name}") == key:
            return robot, f"/{name}"
    raise SchemaError(f"not a service's key: {key[:200]!r}")


def monitor_pulse(monitor: str) -> str:
    """Return the key of the messages that a monitor sends itself to check that it can receive."""
    check_name("monitor", monitor)
    return f"services/monitor/{monitor}/pulse"


EVERY_ROBOT_ALIVE: Final = f"fleet/*/{ALIVE}"
EVERY_GATEWAY_STATUS: Final = "fleet/*/status"

INVENTORY: Final = "services/monitor/inventory"
"""The key under which the monitor answers an InventoryRequest, also an empty one, with an InventoryAnswer."""

COLLECT: Final = "services/collect"
"""The key under which `fleetsight collect --asked` answers a PictureRequest with a SavedPicture."""


@dataclass(frozen=True, slots=True)
class StreamKey:
    """One stream of a camera: `fleet/{robot}/{camera}/{stream}`."""

    camera: CameraKey
    stream: Stream

    def __str__(self) -> str:
        return self.camera.stream(self.stream)

    @property
    def name(self) -> str:
        """The name of the stream among the robot's, such as `front/color`; see `sensor_key`."""
        return f"{self.camera.camera}/{self.stream}"

    @property
    def alive(self) -> str:
        """The key of the presence token that says this stream can be had."""
        return self.camera.alive(self.stream)


@dataclass(frozen=True, slots=True)
class RobotStreamKey:
    """One stream that belongs to the whole robot: `fleet/{robot}/{stream}`, with `ros/{topic}` being one stream each.

    Raises:
        SchemaError: a name that cannot be a chunk of a key, or not such a stream.
    """

    robot: str
    stream: str

    def __post_init__(self) -> None:
        check_name("robot", self.robot)
        match self.stream.split("/"):
            case [stream] if stream in ROBOT_STREAMS | ROBOT_RESULTS:
                return
            case [stream, first, *_] if stream in NAMED_STREAMS and first == BUDGET:
                raise SchemaError(f"stream name {self.stream!r}: {BUDGET!r} is reserved")
            case [stream, _, *_] if stream in NAMED_STREAMS and len(self.stream) <= MAX_NAMED:
                self._check_chunks()
            case _:
                raise SchemaError(f"not a stream of a whole robot: {self.stream[:MAX_NAMED]!r}")

    def _check_chunks(self) -> None:
        for chunk in self.stream.split("/"):
            check_name("stream", chunk)
            if chunk == ALIVE:
                raise SchemaError(f"stream name {self.stream!r}: {ALIVE!r} is reserved")

    def __str__(self) -> str:
        return f"fleet/{self.robot}/{self.stream}"

    @property
    def name(self) -> str:
        """The name of the stream among the robot's, such as `ros/battery`; see `sensor_key`."""
        return self.stream

    @property
    def kind(self) -> str:
        """Its member of ROBOT_STREAMS, ROBOT_RESULTS or NAMED_STREAMS."""
        return self.stream.partition("/")[0]

    @property
    def alive(self) -> str:
        """The key of the presence token that says this stream can be had."""
        return f"{self}/{ALIVE}"


SENSOR_STREAMS: Final = frozenset({Stream.COLOR, Stream.DEPTH, Stream.INFO, Stream.DEPTH_INFO, Stream.POINTS})
"""Streams that cameras send themselves; the others are derived from them."""

SensorKey = StreamKey | RobotStreamKey


def owner_of(key: SensorKey) -> tuple[str, str]:
    """Return the robot and the camera of a stream, as in headers: no camera if it belongs to the whole robot."""
    return (key.camera.robot, key.camera.camera) if isinstance(key, StreamKey) else (key.robot, "")


def sensor_key(robot: str, name: str) -> SensorKey:
    """Return the key of a sensor stream named `{camera}/{stream}`, or `{stream}` if it belongs to the whole robot.

    Raises:
        SchemaError: the name is neither.
    """
    if name.partition("/")[0] in RESERVED - ROBOT_RESULTS:
        return RobotStreamKey(robot, name)
    match name.split("/"):
        case [camera, stream] if stream in SENSOR_STREAMS:
            return StreamKey(CameraKey(robot, camera), Stream(stream))
    raise SchemaError(f"not a stream that sensors send: {name[:MAX_NAMED]!r}")


@lru_cache(REMEMBERED)
def parse_stream(key: str) -> StreamKey:
    """Parse the key of a camera's stream, or of that stream's presence token.

    Raises:
        SchemaError: the key is neither.
    """
    match key.removesuffix(f"/{ALIVE}").split("/"):
        case ["fleet", robot, camera, *stream] if "/".join(stream) in set(Stream):
            return StreamKey(camera_key(robot, camera), Stream("/".join(stream)))
    raise SchemaError(f"not the key of a camera's stream: {key[:200]!r}")


def parse_robot(key: str) -> str:
    """Return the robot of a robot-wide key (`fleet/{robot}/{what}`).

    Raises:
        SchemaError: the key is not of that form.
    """
    match key.split("/"):
        case ["fleet", robot, what] if what in RESERVED:
            check_name("robot", robot)
            return robot
    raise SchemaError(f"not a robot's key: {key[:200]!r}")
