"""Checks topics and their publishers as a subscriber sees them. Pure."""

import difflib
from collections.abc import Iterator, Sequence
from statistics import median
from typing import Final

from gateway.doctor.advice import further, untranslated
from gateway.doctor.evidence import Evidence, Failure, Graph, Heard, PublisherLook, StreamLook, Trouble
from gateway.doctor.finding import Finding, Stage, fine, note, problem
from gateway.doctor.sources import check_sources
from gateway.exploring import MAX_LISTED
from gateway.ros1.errors import UnknownTypeError
from gateway.ros1.messages import message_type
from gateway.ros1.wire.tcpros import ANY, TopicType
from gateway.settings import MIB, MOST_MIB
from gateway.to_bus.translators.images import NOT_COLOR
from schemas.keys import Stream, StreamKey

CLOCK: Final = "ros/clock"
LATE_S: Final = 2.0
"""Age on arrival above which a message's stamps are reported."""


def check_stamps(subject: str, heard: Heard, evidence: Evidence) -> Iterator[Finding]:
    """Check that a publisher's stamps are current."""
    if not heard.stamps_ns:
        return
    if not any(heard.stamps_ns):
        yield note(
            Stage.SENSORS,
            subject,
            "its stamps are zero: nothing can be matched with it in time",
            "have the driver fill header.stamp",
        )
        return
    if evidence.master.sim_time:
        yield from _check_against_clock(subject, heard, evidence)
        return
    late_s = median(heard.lags_ns) / 1e9
    if abs(late_s) > LATE_S:
        way = "behind" if late_s > 0 else "ahead of"
        yield note(
            Stage.SENSORS,
            subject,
            f"its stamps are {_span(late_s)} {way} this machine's clock",
            "synchronise the clocks (chrony), or set use_sim_time and `rosbag play --clock` if a bag is played",
        )


def _check_against_clock(subject: str, heard: Heard, evidence: Evidence) -> Iterator[Finding]:
    now_ns = sim_now_ns(evidence)
    if now_ns is None:
        return
    late_s = (now_ns - heard.stamps_ns[-1]) / 1e9
    if abs(late_s) > LATE_S + evidence.seconds:
        way = "behind" if late_s > 0 else "ahead of"
        what = f"its stamps are {_span(late_s)} {way} /clock, the ROS time while use_sim_time is set"
        yield note(Stage.SENSORS, subject, what, "do the driver and the simulation or bag use the same clock?")


def check_sim_clock(evidence: Evidence) -> Iterator[Finding]:
    """Check that the simulation's clock runs."""
    if sim_now_ns(evidence) is None:
        yield problem(
            Stage.SENSORS,
            "/clock",
            "use_sim_time is set, but nothing comes on /clock: time stands still for ROS nodes",
            "start the simulation or `rosbag play --clock`, or `rosparam set use_sim_time false` and restart the nodes",
        )


def sim_now_ns(evidence: Evidence) -> int | None:
    """Return the last time received on /clock, in nanoseconds."""
    clock = evidence.named(CLOCK)
    return clock.heard.stamps_ns[-1] if clock and clock.heard.stamps_ns else None


def _span(seconds: float) -> str:
    size = abs(seconds)
    for unit, length in (("days", 86_400), ("hours", 3_600), ("minutes", 60)):
        if size >= 2 * length:
            return f"{size / length:.0f} {unit}"
    return f"{size:.1f} s"


_START_RIGHT: Final = "start that node with ROS_IP set to its machine's address, and without ROS_HOSTNAME"
"""Advice for a node that registers a wrong address, such as the loopback or an outdated one."""


def check_sensors(evidence: Evidence) -> Iterator[Finding]:
    """Check for every stream that its topic can be forwarded."""
    graph = evidence.master.graph
    if graph is None:
        return
    if evidence.master.sim_time:
        yield from check_sim_clock(evidence)
    if not evidence.streams:
        yield problem(
            Stage.SENSORS,
            evidence.robot,
            "no topic becomes a stream",
            "start the sensors' drivers, or name their topics: --discover --cameras NAME=TOPIC",
        )
    for stream in evidence.streams:
        yield from check_stream(stream, graph, evidence)
    for topic, why in sorted(evidence.left_out.items()):
        yield note(Stage.SENSORS, topic, f"not taken: {why}")
    if evidence.undiscovered:
        yield note(
            Stage.SENSORS,
            _some(evidence.undiscovered),
            "not taken: only the streams that --cameras and --topics name are",
            "--discover takes what is found as well",
        )
    for option in evidence.unused:
        yield note(Stage.SENSORS, option, "there is no such stream", "is its name misspelt, or its driver not started?")


def _some(topics: Sequence[str]) -> str:
    more = len(topics) - MAX_LISTED
    return ", ".join(topics[:MAX_LISTED]) + (f" and {more} more" if more > 0 else "")


def check_stream(stream: StreamLook, graph: Graph, evidence: Evidence) -> Iterator[Finding]:
    """Check that a stream's topic can be forwarded."""
    if not stream.publishers:
        yield _unpublished(stream, graph)
    elif not _carries(stream, stream.type):
        yield _wrong_type(stream, stream.type, evidence)
    else:
        for publisher in stream.publishers:
            yield from _check_publisher(stream, publisher, evidence)
        yield from check_sources(stream)


def _unpublished(stream: StreamLook, graph: Graph) -> Finding:
    """Report a topic without publishers; the master also knows topics that only have subscribers."""
    what = "nobody publishes it" if stream.topic in graph.topics else "no such topic exists"
    fitting = [topic for topic in graph.publishers if _carries(stream, graph.types.get(topic, ANY))]
    close = difflib.get_close_matches(stream.topic, fitting, n=3, cutoff=0.5)
    named = f"did you mean {' or '.join(close)}? " if close else ""
    advice = f"{named}Start the sensor's driver, or name another topic: `rostopic list` shows all there are"
    return problem(Stage.SENSORS, stream.subject, what, advice)


def _carries(stream: StreamLook, type_name: str) -> bool:
    translators = stream.kind.translators
    return type_name in {"", ANY} or ANY in translators or type_name in translators


def _wrong_type(stream: StreamLook, type_name: str, evidence: Evidence) -> Finding:
    carried = " or ".join(stream.kind.translators)
    return problem(
        Stage.SENSORS,
        stream.subject,
        f"is a {type_name}, which the stream cannot carry: it carries {carried}",
        f"name a topic of such a type, or forward this one untranslated: {untranslated(stream, evidence)}",
    )


def _check_publisher(stream: StreamLook, publisher: PublisherLook, evidence: Evidence) -> Iterator[Finding]:
    if publisher.trouble is not None:
        what, advice = _publisher_trouble(publisher, publisher.trouble)
        say = note if stream.heard.arrivals_s else problem  # one working publisher is enough
        yield say(Stage.SENSORS, stream.subject, what, advice)
    elif publisher.type is not None and not _carries(stream, publisher.type.name):
        yield _wrong_type(stream, publisher.type.name, evidence)
    elif publisher.type is not None and (ours := _other_version(stream, publisher.type)):
        yield problem(
            Stage.SENSORS,
            stream.subject,
            f"{publisher.node} has another version of {publisher.type.name}: md5sum {publisher.type.md5sum}, "
            f"ours is {ours}",
            f"build its package against the standard message, or forward it untranslated: "
            f"{untranslated(stream, evidence)}",
        )
    else:
        yield from _check_heard(stream, publisher, evidence)


def _publisher_trouble(publisher: PublisherLook, trouble: Trouble) -> tuple[str, str]:
    match trouble.failure:
        case Failure.UNRESOLVED:
            return (
                f"{publisher.node} is registered at {trouble.host}, a name that does not resolve on this machine",
                f"add {trouble.host} to /etc/hosts here; or {_START_RIGHT}",
            )
        case Failure.DEAD:
            return (
                f"{publisher.node} is registered at {trouble.where}, but nothing listens: killed, or address wrong",
                f"start it again (`rosnode cleanup` makes the master forget it); if it runs, {_START_RIGHT}",
            )
        case Failure.UNKNOWN:
            return (f"{publisher.node} left the master just now", "start it again, or ask the doctor again")
        case Failure.TOO_LARGE:
            return f"{publisher.node} sends {trouble.reason}", _advice_on_size(trouble.size)
        case Failure.REFUSED | Failure.FOREIGN:
            return (
                f"{publisher.node} refuses its subscribers: {trouble.reason}",
                "restart that node; another program may have taken its port",
            )
        case _:
            return (
                f"{publisher.node} does not answer at {trouble.where} ({trouble.reason or trouble.failure.value})",
                f"does it hang, or is a firewall in between (ROS nodes listen on any free port)? Or {_START_RIGHT}",
            )


def _advice_on_size(size: int) -> str:
    smaller = "have the driver send smaller or compressed messages"
    needed_mib = -(-size // MIB)
    if needed_mib > MOST_MIB:
        return smaller
    return f"give the gateway --max-message-mib {needed_mib} or more, or {smaller}"


def _other_version(stream: StreamLook, found: TopicType) -> str:
    """Return our md5sum of the type if it differs from the publisher's and the translator needs it."""
    if ANY in stream.kind.translators:
        return ""
    try:
        ours = message_type(found.name)
    except UnknownTypeError:
        return ""
    return "" if ours.md5sum == found.md5sum else ours.md5sum


def _check_heard(stream: StreamLook, publisher: PublisherLook, evidence: Evidence) -> Iterator[Finding]:
    heard, subject = publisher.heard, stream.subject
    if not heard.arrivals_s:
        yield _nothing_heard(stream, publisher, evidence)
    elif NOT_COLOR in heard.unreadable and isinstance(stream.key, StreamKey):
        yield problem(
            Stage.SENSORS,
            subject,
            f"{publisher.node} sends depth, which is used as colour: {heard.unreadable}",
            f"name it as depth: {further(f'{stream.key.camera.camera}/{Stream.DEPTH}', stream.topic, evidence)}",
        )
    elif heard.unreadable:
        yield problem(
            Stage.SENSORS,
            subject,
            f"{publisher.node} sends messages that cannot be forwarded: {heard.unreadable}",
            f"correct the driver's settings, or forward it untranslated: {untranslated(stream, evidence)}",
        )
    else:
        yield fine(Stage.SENSORS, subject, f"{publisher.node} sends {_pace(publisher)}, {_size(heard.size)} each")
        if not publisher.latching:
            yield from check_stamps(subject, heard, evidence)


def _nothing_heard(stream: StreamLook, publisher: PublisherLook, evidence: Evidence) -> Finding:
    what = f"{publisher.node} accepts subscribers but sent nothing in {evidence.seconds:g} s"
    if publisher.latching or not isinstance(stream.key, StreamKey):
        return note(Stage.SENSORS, stream.subject, what, "fine if it publishes on events only")
    return problem(
        Stage.SENSORS,
        stream.subject,
        what,
        "is the sensor plugged in and the driver not paused or waiting? Its output (rosout, `rosnode info`) says more",
    )


def _pace(publisher: PublisherLook) -> str:
    if publisher.latching and len(publisher.heard.arrivals_s) == 1:
        return "one latched message"
    rate = publisher.heard.rate_hz
    return "one message" if rate is None else f"{rate:.1f} messages/s"


def _size(size: int) -> str:
    return f"{size} bytes" if size < 10_000 else f"{size / 1e6:.2f} MB"
