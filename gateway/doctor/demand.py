"""Checks which streams are wanted, and whether the running gateway delivers them. Pure."""

import re
from collections.abc import Iterator
from typing import Final

import msgspec

from gateway.doctor.evidence import Evidence, GatewayReport, StreamLook
from gateway.doctor.finding import Finding, Stage, fine, note, problem
from gateway.node_names import is_gateway
from gateway.ros1.tcpros.subscriber import LinkFailure
from gateway.to_bus.stream import MALFORMED, MISMATCH
from gateway.to_bus.translators import kind_of
from gateway.to_ros.outputs import cure, recorders, results_of
from schemas.status import (
    BEYOND_USE,
    ENDED,
    OVER_BUDGET,
    REPLACED_BEFORE_LINK,
    REPLACED_BEFORE_SHAPING,
    THINNED,
    TOO_LARGE,
    UNSHAPED,
    UNWANTED,
    StreamStatus,
)

_DROPS: Final = {
    MALFORMED: "the publisher's messages are inconsistent: correct the driver; the gateway's log has the details",
    MISMATCH: "map the topic to a stream that carries its type, or to ros/NAME, which carries any",
    REPLACED_BEFORE_LINK: "the link is slower than the camera: a lower rate or size at the camera, or a better link",
    OVER_BUDGET: "the uplink budget is used up: raise it, or ask less of this stream (rate, size, compression)",
    BEYOND_USE: "the consumers cannot process more: start more workers",
    THINNED: "max_hz limits the stream: raise it if more is needed",
    REPLACED_BEFORE_SHAPING: "this machine compresses slower than the camera sends: lower the rate or the size",
    TOO_LARGE: "a stream carries no more than 128 MiB at a time: scale it, or have the driver send less",
    UNSHAPED: "this stream's scaling or compression does not suit its images: change it",
    ENDED: "they were in transit when the subscriber or the publisher left; this is normal",
    UNWANTED: "they came in the two seconds for which the topic stays subscribed; this is normal",
}
_LINKS: Final = {
    LinkFailure.UNREACHABLE: "a publisher cannot be reached from the gateway: see the sensors above",
    LinkFailure.REFUSED: "a publisher refuses: restart it",
    LinkFailure.MISMATCH: "publishers of one topic have different types",
    LinkFailure.TOO_LARGE: "a publisher's messages are over --max-message-mib: raise it, or have it send smaller ones",
    LinkFailure.PROTOCOL: "something that is not a ROS node answers: restart the publisher",
    LinkFailure.CLOSED: "a publisher closes its connections: it was restarted, or its network is unreliable",
}


def check_demand(evidence: Evidence) -> Iterator[Finding]:
    """Report for every stream whether it is wanted, and whether it is delivered then."""
    account = max(evidence.bus.accounts, key=lambda each: each.count, default=None)
    if account is None:
        return
    for stream in evidence.streams:
        now = _status_of(account.last.streams, stream.name)
        before = _status_of(account.first.streams, stream.name)
        if now is None and _has_no_picture(stream):
            continue  # the finding on its sensor says why the gateway does not offer it
        if now is None:
            yield problem(
                Stage.DEMAND,
                stream.name,
                "the running gateway does not offer this stream",
                "it was started with other options: restart it with the doctor's, or give the doctor the gateway's",
            )
        elif now.topic != stream.topic:
            yield problem(
                Stage.DEMAND,
                stream.name,
                f"the running gateway takes it from {now.topic}, not from {stream.topic}",
                "it was started with other options: restart it with the doctor's, or give the doctor the gateway's",
            )
        else:
            if before is None:  # it began since the first status
                before = msgspec.structs.replace(now, received=0, forwarded=0)
            yield from _check_stream(stream, account, before, now)


def check_recorders(evidence: Evidence) -> Iterator[Finding]:
    """Report ROS nodes that subscribe to all of a gateway's results and so request all of them."""
    graph = evidence.master.graph
    if graph is None:
        return
    gateways = {node for nodes in graph.publishers.values() for node in nodes if is_gateway(node)}
    for gateway in sorted(gateways):
        topics = results_of(gateway, graph.publishers)
        for recorder in recorders(topics, graph.subscribers):
            if not re.fullmatch(evidence.passive, recorder):
                yield note(
                    Stage.DEMAND,
                    recorder,
                    f"subscribes to all {len(topics)} results of {gateway}, as `rosbag record -a` does: workers make "
                    "all of them of every camera",
                    cure(recorder),
                )


def _has_no_picture(stream: StreamLook) -> bool:
    """Return whether a stream needs images from clouds that lack colours or organisation, or did not come."""
    colours = stream.special == kind_of(stream.key, of_points=True)
    return colours and (bool(stream.heard.unreadable) or not stream.heard.arrivals_s)


def _status_of(streams: list[StreamStatus], name: str) -> StreamStatus | None:
    return next((each for each in streams if each.name == name), None)


def _check_stream(
    stream: StreamLook, account: GatewayReport, before: StreamStatus, now: StreamStatus
) -> Iterator[Finding]:
    came, went = now.received - before.received, now.forwarded - before.forwarded
    if not now.wanted:
        yield fine(Stage.DEMAND, stream.name, "nobody subscribes, so it is not forwarded; this is normal")
    elif went > 0:
        rate = f" at {went / account.seconds:.1f} messages/s" if account.seconds > 0 else ""
        yield fine(Stage.DEMAND, stream.name, f"wanted, and flowing{rate}")
    elif came > 0:
        yield problem(
            Stage.DEMAND,
            stream.name,
            f"wanted, but none of the {came} messages that came in {account.seconds:.1f} s got through",
            "what was left out, and why, is listed next",
        )
    else:
        yield _nothing_came(stream, account, now)
    yield from _drops(stream, now)


def _nothing_came(stream: StreamLook, account: GatewayReport, now: StreamStatus) -> Finding:
    if not now.publishers:
        failures = ", ".join(f"{reason} {count} times" for reason, count in now.broken_links.items())
        return problem(
            Stage.DEMAND,
            stream.name,
            f"wanted, but the gateway has no connection to a publisher{f' ({failures})' if failures else ''}",
            _link_advice(now),
        )
    if stream.heard.rate_hz is not None and account.count > 1:
        return problem(
            Stage.DEMAND,
            stream.name,
            "wanted and published, but nothing arrives at the gateway",
            "is the gateway at the same ROS master? Its log says what it connects to; restart it if it hangs",
        )
    if now.forwarded:
        return fine(Stage.DEMAND, stream.name, f"wanted; {now.forwarded} messages so far, none just now")
    return note(Stage.DEMAND, stream.name, "wanted, but its publisher has sent nothing yet", "see the sensors above")


def _link_advice(now: StreamStatus) -> str:
    for reason in LinkFailure:
        if reason in now.broken_links:
            return _LINKS[reason]
    return "see the sensors above"


def _drops(stream: StreamLook, now: StreamStatus) -> Iterator[Finding]:
    for reason, count in now.dropped.items():
        if count:
            what = f"{count} of {now.received} messages since the gateway started: {reason}"
            yield note(Stage.DEMAND, stream.name, what, _drop_advice(reason))


def _drop_advice(reason: str) -> str:
    return _DROPS.get(reason, "")
