"""Settings of a robot's gateway."""

import os
import re
import socket
from collections.abc import Collection, Iterator
from typing import Annotated, ClassVar, Final, Self

from pydantic import AfterValidator, BaseModel, Field, model_validator

from bus.settings import BusSettings
from gateway.discovery import DiscoverySettings
from gateway.discovery.plan import INFOS, Plan, Source, cameras_of
from gateway.discovery.published_topics import is_topic
from gateway.ros1.addresses import validate_host, validate_master_uri
from gateway.ros1.errors import InvalidNameError
from gateway.ros1.names import Names, validate_global, validate_type
from gateway.ros1.sim_clock import TOPIC as CLOCK
from gateway.ros1.wire.tcpros import ANY, DEFAULT_MAX_MESSAGE_BYTES
from gateway.to_bus.shaping.settings import ShapingSettings
from gateway.to_ros.outputs import ALERTS_TOPIC, RESULTS, is_result, result_root
from gateway.to_ros.world import OBJECTS_TOPIC, OBSTACLES_TOPIC
from gateway.topic_conflicts import check_uses
from schemas.errors import SchemaError
from schemas.keys import NAME, CameraKey, SensorKey, Stream, StreamKey, robot_alive, sensor_key, service

MAX_SERVICES: Final = 64

MIB: Final = 1 << 20
MOST_MIB: Final = 1024
"""ROS 1's own nodes accept no message over 1 GB."""


def master_uri() -> str:
    """Return ROS_MASTER_URI, or a master's default address."""
    return os.environ.get("ROS_MASTER_URI") or "http://127.0.0.1:11311"


def host_variable() -> str | None:
    """Return the name of the ROS variable that sets this machine's host, if one does."""
    return next((name for name in ("ROS_HOSTNAME", "ROS_IP") if os.environ.get(name)), None)


def host_name() -> str:
    """Return the host that other ROS nodes connect to: ROS_HOSTNAME, ROS_IP or this machine's name."""
    variable = host_variable()
    return os.environ[variable] if variable else socket.gethostname()


def ros_namespace() -> str:
    """Return ROS_NAMESPACE, or the root."""
    return os.environ.get("ROS_NAMESPACE") or "/"


def _namespace(namespace: str) -> str:
    chunks = namespace.strip("/")
    return validate_global(f"/{chunks}") if chunks else "/"


def _node_name(name: str) -> str:
    if "/" in name:
        raise ValueError("a node's name is one word; --namespace says where it is")
    return validate_global(f"/{name}")[1:] if name else name


def _remaps(remaps: dict[str, str]) -> dict[str, str]:
    Names("/gateway", remaps)
    return remaps


def robot_name(name: str) -> str:
    """Return a robot's name; raise ValueError unless it can be one."""
    try:
        robot_alive(name)
    except SchemaError as error:
        raise ValueError(str(error)) from error
    return name


def _cameras(cameras: dict[str, str]) -> dict[str, str]:
    for camera, topic in cameras.items():
        try:
            CameraKey("robot", camera)
        except SchemaError as error:
            raise ValueError(str(error)) from error
        _check_topic(f"camera {camera}", topic)
    return cameras


def _topics(topics: dict[str, str]) -> dict[str, str]:
    for name, topic in topics.items():
        try:
            sensor_key("robot", name)
        except SchemaError as error:
            raise ValueError(f"{error}; one looks like front/depth or tf") from error
        _check_topic(f"stream {name}", topic)
    return topics


def _rectified(streams: list[str]) -> list[str]:
    for name in streams:
        try:
            key = sensor_key("robot", name)
        except SchemaError as error:
            raise ValueError(str(error)) from error
        if not isinstance(key, StreamKey) or key.stream not in INFOS:
            raise ValueError(f"{name} is not a camera's image stream; those are named like front/color or front/depth")
    return streams


def _actions(actions: dict[str, str]) -> dict[str, str]:
    for name, topic in actions.items():
        if not NAME.fullmatch(name):
            raise ValueError(f"{name!r} is not an action's name; use one like pick_up")
        _check_topic(f"action {name}", topic)
    return actions


def _check_topic(what: str, topic: str) -> None:
    if not is_topic(topic if topic.startswith("/") else f"/{topic}"):
        raise ValueError(f"{what}: {topic!r} is not a ROS topic; use one like /front/color/image_raw")
    if is_result(topic):
        raise ValueError(f"{what}: {topic} is where gateways publish results; name a sensor's topic")


def _services(services: list[str]) -> list[str]:
    if len(services) > MAX_SERVICES:
        raise ValueError(f"{len(services)} services, at most {MAX_SERVICES} may be called")
    for name, sign, kind in (entry.partition("=") for entry in services):
        try:
            service("robot", name)
            if sign:
                validate_type(kind)
        except (SchemaError, InvalidNameError) as error:
            raise ValueError(str(error)) from error
    names = [entry.partition("=")[0] for entry in services]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"{twice[0]} is named twice")
    return services


def _pattern(pattern: str) -> str:
    try:
        re.compile(pattern)
    except re.error as error:
        raise ValueError(f"not a regular expression: {error}") from error
    return pattern


class RosSettings(BaseModel):
    """Settings of the robot's ROS graph and of the node in it."""

    heading: ClassVar = "ROS"

    ros_master: Annotated[str, AfterValidator(validate_master_uri)] = Field(
        default_factory=master_uri,
        validate_default=True,
        description="the ROS master's address; ROS_MASTER_URI by default",
    )
    ros_host: Annotated[str, AfterValidator(validate_host)] = Field(
        default_factory=host_name,
        validate_default=True,
        description="where other ROS nodes reach this machine; ROS_HOSTNAME or ROS_IP by default",
    )
    namespace: Annotated[str, AfterValidator(_namespace)] = Field(
        default_factory=ros_namespace,
        validate_default=True,
        description="ROS namespace of the node, its results and relative names; ROS_NAMESPACE by default",
    )
    node_name: Annotated[str, AfterValidator(_node_name)] = Field(
        default="", description="the ROS node's name; a unique one by default"
    )
    remap: Annotated[
        dict[str, str],
        AfterValidator(_remaps),
        Field(description="topic names to replace, as from=to; from:=to works too, as for any ROS node"),
    ] = {}

    def host_given_by(self) -> str:
        """Return the origin of `ros_host`: the option, a variable or the host name."""
        return "--ros-host" if "ros_host" in self.model_fields_set else host_variable() or "this machine's host name"


class StreamSettings(BaseModel):
    """Settings that select the topics that become streams."""

    heading: ClassVar = "streams"

    discover: bool = Field(
        default=True,
        description="find streams on the ROS graph; off by default when --cameras or --topics name streams",
    )
    allow: Annotated[str, AfterValidator(_pattern)] = Field(
        default=".*",
        description="take only found topics whose whole name matches this regular expression, like /r1/.*|/tf",
    )
    deny: Annotated[str, AfterValidator(_pattern)] = Field(
        default="",
        description="take no found topic whose whole name matches this regular expression; wins over --allow",
    )
    cameras: Annotated[
        dict[str, str],
        AfterValidator(_cameras),
        Field(
            description="colour cameras as name=topic, several separated by commas; the first one's results go to "
            "/ultralytics/..., another's to /ultralytics/NAME/..."
        ),
    ] = {}
    topics: Annotated[
        dict[str, str],
        AfterValidator(_topics),
        Field(description="further streams as stream=topic, like front/depth=/front/depth/image_raw or tf=/tf"),
    ] = {}
    rectified: Annotated[
        list[str],
        AfterValidator(_rectified),
        Field(
            description="streams that are already rectified, like front/color; those with image_rect in their topics' "
            "names count as rectified anyway"
        ),
    ] = []
    max_message_mib: Annotated[
        int,
        Field(
            ge=1,
            le=MOST_MIB,
            description="largest ROS message that is read, in MiB; 6000x4000 rgb8 pixels have 69. More than 128 is for "
            "images that --scale makes smaller: a stream carries no more",
        ),
    ] = DEFAULT_MAX_MESSAGE_BYTES // MIB

    @property
    def max_message_bytes(self) -> int:
        """The largest ROS message that is read, in bytes."""
        return self.max_message_mib * MIB


class ReturnSettings(BaseModel):
    """Settings of messages from the fleet to the robot."""

    heading: ClassVar = "from the fleet to ROS"

    results: bool = Field(
        default=True,
        description="publish the cameras' results, the alerts and the objects around on the robot's own ROS graph",
    )
    own_obstacles: bool = Field(
        default=True,
        description="/fleetsight/obstacles has what the robot itself sees, too, not only what others see",
    )
    actions: Annotated[
        dict[str, str],
        AfterValidator(_actions),
        Field(
            description="actions that the fleet may send to the robot, as action=topic, like pick_up=/planner/pick_up; "
            "every other action is refused"
        ),
    ] = {}
    passive_subscribers: Annotated[str, AfterValidator(_pattern)] = Field(
        default="",
        description="ROS nodes whose subscriptions request no results, by a regular expression for whole names, like "
        "/record_.* for rosbag's recorders; they receive what others request",
    )
    services: Annotated[
        list[str],
        AfterValidator(_services),
        Field(
            description="ROS services that the fleet may call, by their exact names, like /reset; "
            "/reset=std_srvs/Trigger only while it is of that type"
        ),
    ] = []


class GatewaySettings(RosSettings, StreamSettings, ShapingSettings, ReturnSettings, BusSettings):
    """Forward a robot's ROS 1 sensors onto Zenoh, and its cameras' results back, while somebody wants them.

    Runs on the robot, needs no ROS install. Finds cameras, lidars and transforms by the names and types of what is
    published, now and later, and says what it takes and what not; --cameras and --topics name streams instead.
    """

    robot: Annotated[str, AfterValidator(robot_name), Field(description="this robot's name, unique in the fleet")]

    @model_validator(mode="after")
    def _one_use_for_each_topic(self) -> Self:
        if both := [camera for camera in self.cameras if f"{camera}/{Stream.COLOR}" in self.topics]:
            raise ValueError(f"--cameras and --topics both give {both[0]}/{Stream.COLOR}")
        check_uses(self._uses())
        return self

    @model_validator(mode="after")
    def _discovers_beside_names_only_when_told(self) -> Self:
        if "discover" not in self.model_fields_set:
            self.discover = not self.streams()
        if not self.discover and not self.streams():
            raise ValueError("--no-discover leaves nothing to send unless --cameras or --topics name streams")
        return self

    def _uses(self) -> Iterator[tuple[str, str]]:
        resolve = self.names().resolve
        streams = Plan({key: Source(topic) for key, topic in self.streams().items()})
        for key, source in streams.streams.items():
            if not streams.of_points(key):
                yield source.topic, f"stream {key.name}"
        for action, topic in self.actions.items():
            yield resolve(topic), f"action {action}"
        if self.results:
            yield resolve(ALERTS_TOPIC), "the alerts"
            yield resolve(OBSTACLES_TOPIC), "the obstacles"
            yield resolve(OBJECTS_TOPIC), "the objects around"
            cameras = [found.camera for found in cameras_of(self.streams())] or ["the first camera"]
            for place, camera in enumerate(cameras):
                root = result_root(camera, first=not place)
                for stream, topic in RESULTS.items():
                    yield resolve(f"{root}/{topic}"), f"{stream} of {camera}"
        yield CLOCK, "the time that the gateway itself follows (ros_time_ns in its status)"

    def is_passive(self, node: str) -> bool:
        """Return whether a ROS node is passive: its subscriptions request no results."""
        return re.fullmatch(self.passive_subscribers, node) is not None

    def listed_services(self) -> dict[str, str]:
        """Return the required type of each listed service, or `*`."""
        return {name: kind or ANY for name, _, kind in (entry.partition("=") for entry in self.services)}

    def streams(self) -> dict[SensorKey, str]:
        """Return the topic of every named stream."""
        named = {f"{camera}/{Stream.COLOR}": topic for camera, topic in self.cameras.items()} | self.topics
        resolve = self.names().resolve
        return {sensor_key(self.robot, name): resolve(topic) for name, topic in named.items()}

    def names(self, node: str = "gateway") -> Names:
        """Return the name resolution of a node with this name, or with `node_name` if that is set."""
        return Names(f"{self.namespace.rstrip('/')}/{self.node_name or node}", self.remap)

    def unused(self, names: Collection[str]) -> list[str]:
        """Return the options for streams other than these, which may be misspelt."""
        rectified = (f"--rectified {name}" for name in self.rectified if name not in names)
        return [*self.unused_shaping(names), *rectified]

    def discovery_settings(self) -> DiscoverySettings:
        """Return the settings of discovery."""
        return DiscoverySettings(
            self.robot,
            self.streams(),
            self.discover,
            re.compile(self.allow),
            re.compile(self.deny),
            frozenset(sensor_key(self.robot, name) for name in self.rectified),
        )
