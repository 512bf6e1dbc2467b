"""Keys by which consumers declare their subscriptions to a robot's streams, and the rate they can use."""

from dataclasses import dataclass
from uuid import uuid4

from schemas.errors import SchemaError
from schemas.keys import (
    BUDGET,
    NAME,
    ROBOT_STREAMS,
    WANTED,
    CameraKey,
    RobotStreamKey,
    SensorKey,
    check_name,
    parse_stream,
)


def budget(camera: CameraKey, consumer: str) -> str:
    """Return the key of one consumer's RateBudgets for a camera: nobody speaks for another where access is ruled."""
    check_name("consumer", consumer)
    return f"fleet/{camera}/{BUDGET}/{consumer}"


def every_budget(robot: str) -> str:
    """Return the key expression of the RateBudgets of a robot's cameras."""
    check_name("robot", robot)
    return f"fleet/{robot}/*/{BUDGET}/*"


def parse_budget(key: str) -> tuple[CameraKey, str]:
    """Return the camera and the consumer of a key of RateBudgets.

    Raises:
        SchemaError: the key is none.
    """
    match key.split("/"):
        case ["fleet", robot, camera, what, consumer] if what == BUDGET:
            check_name("consumer", consumer)
            return CameraKey(robot, camera), consumer
    raise SchemaError(f"not the key of a camera's budgets: {key[:200]!r}")


@dataclass(frozen=True, slots=True)
class Wanted:
    """A consumer's declaration that it subscribes to a camera's stream or one of ROBOT_STREAMS, and its host.

    clock_id: of its machine. consumer: has one token of a stream on a machine: a worker's name, or a `new_consumer`.

    Raises:
        SchemaError: a name that cannot be a chunk of a key.
    """

    key: "SensorKey"
    clock_id: str
    consumer: str

    def __post_init__(self) -> None:
        check_name("clock", self.clock_id)
        check_name("consumer", self.consumer)

    def __str__(self) -> str:
        return f"{self.key}/{WANTED}/{self.clock_id}/{self.consumer}"


def new_consumer(certificate: str) -> str:
    """Return a consumer's name that nobody else has: nobody shows another's where access is ruled.

    certificate: the name with which it begins, followed by a dash; empty without one.
    """
    unique = uuid4().hex
    own = f"{certificate}-{unique[:12]}"
    return own if NAME.fullmatch(own) else unique


def every_wanted(robot: str) -> str:
    """Return the key expression of the presence tokens of a robot's subscribers."""
    check_name("robot", robot)
    return f"fleet/{robot}/*/**/{WANTED}/*/*"


def parse_wanted(key: str) -> Wanted:
    """Parse a subscriber's presence token.

    Raises:
        SchemaError: the key is none.
    """
    stream, _, consumer = key.partition(f"/{WANTED}/")
    match consumer.split("/"):
        case [clock_id, name]:
            return Wanted(_parse_wanted_stream(stream), clock_id, name)
    raise SchemaError(f"not a subscriber's key: {key[:200]!r}")


def _parse_wanted_stream(key: str) -> "SensorKey":
    match key.split("/"):
        case ["fleet", robot, stream] if stream in ROBOT_STREAMS:
            return RobotStreamKey(robot, stream)
    return parse_stream(key)
