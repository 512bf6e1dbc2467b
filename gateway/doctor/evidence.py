"""Evidence that the checks judge. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

from gateway.ros1.wire.tcpros import TopicType
from gateway.to_bus.translators import StreamKind, kind_of
from schemas import codec
from schemas.keys import SensorKey, Stream, StreamKey
from schemas.status import GatewayStatus


class Failure(Enum):
    """Reason why a program could not be reached or understood."""

    UNRESOLVED = "its host name does not resolve here"
    DEAD = "nothing listens there"
    SILENT = "no answer"
    OFF = "it cannot be reached"
    REFUSED = "it refuses"
    FOREIGN = "it speaks another protocol"
    TOO_LARGE = "its messages are over the limit"
    UNKNOWN = "the master does not know it"


@dataclass(frozen=True, slots=True)
class Trouble:
    """A failure where it happened; reason is the error in words. size: of a message that is too large, in bytes."""

    failure: Failure
    host: str
    port: int
    reason: str = ""
    size: int = 0

    @property
    def where(self) -> str:
        return f"{self.host}:{self.port}"


@dataclass(frozen=True, slots=True)
class Graph:
    """The master's lists: node names by topic, and types by topic."""

    publishers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    subscribers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    types: Mapping[str, str] = field(default_factory=dict)

    @property
    def topics(self) -> frozenset[str]:
        return frozenset({*self.publishers, *self.subscribers, *self.types})


@dataclass(frozen=True, slots=True)
class MasterLook:
    """The ROS master. remote: it runs on another machine. graph: None unless it answered."""

    uri: str
    trouble: Trouble | None = None
    graph: Graph | None = None
    remote: bool = False
    sim_time: bool = False


@dataclass(frozen=True, slots=True)
class HostLook:
    """The host that other nodes connect to. addresses: empty if it does not resolve. ours: can be listened at."""

    host: str
    addresses: tuple[str, ...] = ()
    ours: bool = False


@dataclass(frozen=True, slots=True)
class Heard:
    """Messages of one publisher.

    arrivals_s: on a steady clock. size: bytes of the largest. stamps_ns and lags_ns (system clock at arrival, less the
    stamp) are empty for types without a header. messages: the first few as the gateway would send them; unreadable: why
    it would not.
    """

    arrivals_s: tuple[float, ...] = ()
    size: int = 0
    stamps_ns: tuple[int, ...] = ()
    lags_ns: tuple[int, ...] = ()
    messages: tuple[codec.Message, ...] = ()
    unreadable: str = ""

    @property
    def message(self) -> codec.Message | None:
        return self.messages[0] if self.messages else None

    @property
    def rate_hz(self) -> float | None:
        if len(self.arrivals_s) < 2 or self.arrivals_s[-1] <= self.arrivals_s[0]:
            return None
        return (len(self.arrivals_s) - 1) / (self.arrivals_s[-1] - self.arrivals_s[0])


@dataclass(frozen=True, slots=True)
class PublisherLook:
    """One publisher of a topic. type: from its header, once connected."""

    node: str
    trouble: Trouble | None = None
    type: TopicType | None = None
    latching: bool = False
    heard: Heard = Heard()


@dataclass(frozen=True, slots=True)
class StreamLook:
    """One topic for one stream.

    type: what the master says, empty if nothing. special: what the stream carries where its key does not tell.
    """

    key: SensorKey
    topic: str
    type: str = ""
    publishers: tuple[PublisherLook, ...] = ()
    special: StreamKind | None = None

    @property
    def kind(self) -> StreamKind:
        """The kind of the stream."""
        return self.special or kind_of(self.key)

    @property
    def name(self) -> str:
        """The stream as the settings name it."""
        return self.key.name

    @property
    def subject(self) -> str:
        return f"{self.name} ({self.topic})"

    @property
    def heard(self) -> Heard:
        """The messages of the first publisher that sent any."""
        return next((each.heard for each in self.publishers if each.heard.arrivals_s), Heard())


@dataclass(frozen=True, slots=True)
class Router:
    """An endpoint of the bus, and why it cannot be connected to."""

    endpoint: str
    trouble: Trouble | None = None


@dataclass(frozen=True, slots=True)
class GatewayReport:
    """Statuses of one gateway process: the first and last received, and their number.

    skew_s: how far its clock is ahead of this machine's. since_s, until_s: when the two arrived, on a steady clock.
    """

    first: GatewayStatus
    last: GatewayStatus
    count: int
    skew_s: float = 0.0
    since_s: float = 0.0
    until_s: float = 0.0

    @property
    def seconds(self) -> float:
        return (self.last.sent_ns - self.first.sent_ns) / 1e9

    def overlaps(self, other: "GatewayReport") -> bool:
        """Return whether both were running at the same time, rather than one after a restart of the other."""
        return self.since_s < other.until_s and other.since_s < self.until_s


@dataclass(frozen=True, slots=True)
class BusLook:
    """The state of the bus. robots: those with a gateway present. accounts: statuses of this robot's gateways.

    at_home_only: those were found where the gateway listens, and not among those that it connects to.
    """

    routers: tuple[Router, ...] = ()
    robots: frozenset[str] = frozenset()
    accounts: tuple[GatewayReport, ...] = ()
    at_home_only: bool = False


@dataclass(frozen=True, slots=True)
class Evidence:
    """All evidence of one visit.

    beside: topics that no stream is made of but that tell about the others. left_out: why, by topic, of those of a type
    that sensors have. unused: options that are for none of the streams. discover: whether streams are found besides
    those that the settings name, which are `by_hand`. undiscovered: topics that would be streams if they were.
    passive: a pattern of the ROS nodes whose subscriptions make no result wanted.
    """

    robot: str
    seconds: float
    master: MasterLook
    host: HostLook
    bus: BusLook
    streams: tuple[StreamLook, ...] = ()
    beside: tuple[StreamLook, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    unused: Sequence[str] = ()
    discover: bool = True
    by_hand: frozenset[SensorKey] = frozenset()
    undiscovered: Sequence[str] = ()
    passive: str = ""

    def of(self, camera: str, stream: Stream) -> StreamLook | None:
        """Return the look at a camera's stream; a mapped one is preferred."""
        for each in (*self.streams, *self.beside):
            if isinstance(each.key, StreamKey) and (each.key.camera.camera, each.key.stream) == (camera, stream):
                return each
        return None

    def is_mapped(self, camera: str, stream: Stream) -> bool:
        """Return whether a camera's stream is forwarded, not only examined for the sake of others."""
        found = self.of(camera, stream)
        return found is not None and found in self.streams

    def named(self, name: str) -> StreamLook | None:
        """Return the look at a stream by its name; a mapped one is preferred."""
        return next((each for each in (*self.streams, *self.beside) if each.name == name), None)
