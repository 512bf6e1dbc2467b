"""Status messages: what a gateway or worker is doing, and every frame it dropped, by reason."""

from typing import Annotated

import msgspec

from schemas.header import Count, Label, MaybeName, Name, Nanoseconds

Drops = Annotated[dict[Label, Count], msgspec.Meta(max_length=64)]
"""Counts since the process started, by reason."""

MAX_STREAMS = 1_000


class StreamStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One ROS topic on its way to one Zenoh key. Counts are frames since the gateway started.

    camera: empty for what belongs to the whole robot. wanted: somebody on Zenoh subscribes. publishers: ROS publishers
    connected now. broken_links: how often a connection to a ROS publisher failed or ended, by reason.
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


class GatewayStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A gateway's account of itself, once a second and once more when it stops.

    clock_id: names the machine's system clock; times of two messages compare only when theirs are equal.
    sent_ns: that clock when this was sent. waiting_for: what it cannot go on without, in words, or empty.
    """

    robot: Name
    boot_id: Annotated[str, msgspec.Meta(max_length=64)]
    clock_id: Annotated[str, msgspec.Meta(max_length=64)]
    sent_ns: Nanoseconds
    waiting_for: Label = ""
    streams: Annotated[list[StreamStatus], msgspec.Meta(max_length=MAX_STREAMS)] = []


class CameraLoad(msgspec.Struct, frozen=True, kw_only=True):
    """What a worker did with one camera's frames since it started. dropped includes frames lost on the way to it."""

    robot: Name
    camera: Name
    inferred: Count
    dropped: Drops = {}


class WorkerStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A worker's account of itself, once a second and once more when it stops."""

    service: Name
    worker: Name
    model: Label
    sent_ns: Nanoseconds
    cameras: Annotated[list[CameraLoad], msgspec.Meta(max_length=MAX_STREAMS)] = []
