"""Status messages: the work of a gateway or worker, and every frame it dropped, by reason."""

from typing import Annotated, Final

import msgspec

from schemas.header import Count, Label, MaybeName, Name, Nanoseconds

Drops = Annotated[dict[Label, Count], msgspec.Meta(max_length=64)]
"""Counts since the process started, by reason."""

Rate = Annotated[float, msgspec.Meta(ge=0)]

MISSING: Final = "missing on arrival"
"""Reason: a gap in a stream's numbers, as its receiver sees it: replaced before the link, or lost on it."""

REPLACED_BEFORE_LINK: Final = "replaced by a newer frame before the link"
"""Reason: the gateway had a newer frame before the link took this one. Its number is missing at every receiver."""

THINNED: Final = "thinned to max_hz"
"""Reason: the gateway's settings ask for fewer frames. They take no numbers, so no receiver sees a gap."""

BEYOND_USE: Final = "more than anybody can use"
"""Reason: all consumers say what they can use (RateBudget), and it is less. They take no numbers, like THINNED."""

REPLACED_BEFORE_SHAPING: Final = "replaced by a newer frame before it was compressed"
"""Reason: the gateway had a newer frame before it came to scale or compress this one. Its number is missing."""

UNSHAPED: Final = "cannot be scaled or compressed as set"
"""Reason: the settings ask for what this frame's format does not allow. Its number is missing."""

OVER_BUDGET: Final = "over the uplink budget"
"""Reason: the gateway had a newer frame before the uplink's budget allowed this one. Its number is missing."""

TOO_LARGE: Final = "larger than a message may be"
"""Reason: it has more bytes than receivers read (128 MiB), scaled and compressed as set. Its number is missing."""

ENDED: Final = "not sent yet when its stream or its publisher ended"
"""Reason: nothing was there any more to send this one for. Its number is missing."""

UNWANTED: Final = "no longer wanted"
"""Reason: this one was still on its way when the last who wanted it went."""

NUMBERED: Final = (REPLACED_BEFORE_SHAPING, UNSHAPED, OVER_BUDGET, TOO_LARGE, REPLACED_BEFORE_LINK, ENDED)
"""Reasons of gateways for which a frame's number is missing at every receiver."""

MAX_STREAMS: Final = 1_000
MAX_CLASSES: Final = 1_000


class StreamStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One ROS topic on its way to one Zenoh key. Counts are frames since the gateway started.

    camera: empty for what belongs to the whole robot. wanted: somebody on Zenoh subscribes. publishers: ROS publishers
    connected now. broken_links: how often a connection to a ROS publisher failed or ended, by reason. problem: in words
    what keeps publishers from being heard, or clouds from being pictures, now; or empty.
    missing: what ROS publishers numbered and what did not arrive here, by the gaps in their headers' `seq`.
    left_out: how many parts of forwarded messages, such as single transforms, could not be carried.
    repaired: how many messages were put right, such as clouds with a wrong `row_step`.
    received_hz, forwarded_hz: over the last seconds. bytes: payload forwarded. compression: of the last frame, like
    `jpeg:80`; empty for what is no frame.
    """

    camera: MaybeName
    stream: Label
    topic: Label
    wanted: bool
    publishers: Count
    received: Count
    forwarded: Count
    dropped: Drops = {}
    broken_links: Drops = {}
    problem: Label = ""
    received_hz: Rate = 0.0
    forwarded_hz: Rate = 0.0
    bytes: Count = 0
    compression: Label = ""
    missing: Count = 0
    left_out: Count = 0
    repaired: Count = 0

    @property
    def name(self) -> str:
        """The name of the stream among the robot's, as in its key."""
        return f"{self.camera}/{self.stream}" if self.camera else self.stream


class ReturnStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One stream of results on its way to ROS. Counts are messages since the gateway started.

    camera: empty for what belongs to the whole robot. topic: where it goes; several are separated by commas.
    wanted: a ROS subscriber that is not passive is connected, so the gateway subscribes on Zenoh. subscribers: how many
    are connected now, passive ones too.
    received: what arrived on Zenoh. dropped: by reason; a message that one of several subscribers was too slow for is
    among `published` too.
    """

    camera: MaybeName
    stream: Label
    topic: Label
    wanted: bool
    subscribers: Count
    received: Count
    published: Count
    dropped: Drops = {}


class GatewayStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A gateway's status, once a second and once more when it stops.

    clock_id: names the machine's system clock; times of two messages compare only when theirs are equal.
    sent_ns: that clock when this was sent. waiting_for: what it cannot go on without, in words, or empty.
    ros_time_ns: what the robot's /clock says, 0 before it says anything; None where ROS time is the system clock's.
    clock_jumps: how often /clock went back: then what is kept by stamp is of another round.
    streams: what is offered now. withdrawn: drops of streams that are offered no longer; one that comes back counts on.
    version: of its software, empty where nobody says.
    """

    robot: Name
    boot_id: Annotated[str, msgspec.Meta(max_length=64)]
    clock_id: Annotated[str, msgspec.Meta(max_length=64)]
    sent_ns: Nanoseconds
    waiting_for: Label = ""
    ros_time_ns: Nanoseconds | None = None
    clock_jumps: Count = 0
    streams: Annotated[list[StreamStatus], msgspec.Meta(max_length=MAX_STREAMS)] = []
    returns: Annotated[list[ReturnStatus], msgspec.Meta(max_length=MAX_STREAMS)] = []
    withdrawn: Drops = {}
    version: Label = ""


class CameraLoad(msgspec.Struct, frozen=True, kw_only=True):
    """The counts of one camera's frames at a worker since it started. dropped includes those MISSING on arrival.

    serving: the worker looks after the camera now. budget_hz: the rate that its gateway was told of, None where it may
    send all.
    """

    robot: Name
    camera: Name
    inferred: Count
    dropped: Drops = {}
    serving: bool = False
    budget_hz: Rate | None = None


class WorkerStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A worker's status, once a second and once more when it stops.

    remarks: what whoever waits for its results should know, such as which there cannot be, and why.
    classes: names of those that a detector reports when they are in view; empty where nobody says.
    version: of its software, empty where nobody says.
    busy_s: seconds since it started in which it was at work on frames, None where nobody says. A detector's runs while
    any frame is in its model, or its tracker makes the model wait.
    canary: the model of a roll-out that looks at single robots' cameras here; empty where there is none.
    runtime: that the model runs under, such as openvino-int8; empty where nobody says.
    """

    service: Name
    worker: Name
    model: Label
    sent_ns: Nanoseconds
    cameras: Annotated[list[CameraLoad], msgspec.Meta(max_length=MAX_STREAMS)] = []
    remarks: Annotated[list[Label], msgspec.Meta(max_length=16)] = []
    classes: Annotated[list[Label], msgspec.Meta(max_length=MAX_CLASSES)] = []
    version: Label = ""
    busy_s: Annotated[float, msgspec.Meta(ge=0)] | None = None
    canary: Label = ""
    runtime: Label = ""


class ClockReading(msgspec.Struct, frozen=True, kw_only=True):
    """A gateway's answer to an empty request.

    boot_id: the gateway process. clock_id: names the machine's system clock. received_ns, sent_ns: that clock when the
    request arrived and when the answer left, nanoseconds since the epoch. ros_ns: ROS time when the answer left where
    it is not the system clock (/use_sim_time).
    """

    robot: Name
    boot_id: Annotated[str, msgspec.Meta(max_length=64)]
    clock_id: Annotated[str, msgspec.Meta(max_length=64)]
    received_ns: Nanoseconds
    sent_ns: Nanoseconds
    ros_ns: Nanoseconds | None = None
