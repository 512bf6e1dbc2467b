"""Manages the streams offered on the bus and the results offered on ROS as the plan changes."""

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Final

from bus import Bus
from gateway.discovery.plan import NO_PLAN, Plan
from gateway.ros1.node import Node
from gateway.ros1.tasks import cancel_and_wait
from gateway.ros1.wire.tcpros import DEFAULT_MAX_MESSAGE_BYTES
from gateway.to_bus.forward import Forward, offering
from gateway.to_bus.shaping.shaping import Shaping
from gateway.to_bus.stream import StreamForward
from gateway.to_bus.subscriptions import Subscriptions
from gateway.to_bus.translators import StreamKind
from gateway.to_ros.on_demand import Return
from gateway.to_ros.outputs import result_root
from gateway.to_ros.stream import StreamReturn
from schemas.keys import CameraKey, SensorKey
from schemas.status import ReturnStatus, StreamStatus

log = logging.getLogger(__name__)

MAX_RETURNED: Final = 100
"""Most cameras with returned results: a status lists MAX_STREAMS returns, several for each camera."""


@dataclass(slots=True)
class _Offer:
    """One stream on the bus. forward: set while it is offered."""

    task: asyncio.Task[None]
    topic: str
    kind: StreamKind
    offered: asyncio.Event = field(default_factory=asyncio.Event)
    forward: Forward | None = None


@dataclass(slots=True)
class _Results:
    """One camera's results on ROS."""

    streams: list[StreamReturn[Any]]
    returns: list[Return[Any]]
    tasks: set[asyncio.Task[None]]


class Offers:
    """The streams and results that a gateway offers now.

    A stream that is withdrawn and offered again counts on, whatever its topic: its numbers identify frames. So every
    stream is remembered that there ever was; they are few, as plans name MAX_CAMERAS cameras in a gateway's life.

    topics: subscribes to what the streams are made of, once for all that read a topic.
    group: runs the streams until it is cancelled or `close` is called. returned: tells what is returned for a camera,
        given the namespace of its results on ROS. max_message_bytes: longer ROS messages are not read.
    """

    def __init__(
        self,
        group: asyncio.TaskGroup,
        bus: Bus,
        node: Node,
        *,
        boot_id: str,
        shaping: Shaping,
        returned: Callable[[CameraKey, str], list[StreamReturn[Any]]],
        max_message_bytes: int = DEFAULT_MAX_MESSAGE_BYTES,
    ) -> None:
        self._group = group
        self._bus = bus
        self._node = node
        self.topics = Subscriptions(node, max_message_bytes)
        self._boot_id = boot_id
        self._shaping = shaping
        self._returned_for = returned
        self._offers: dict[SensorKey, _Offer] = {}
        self._streams: dict[SensorKey, StreamForward] = {}
        self._withdrawn: Counter[str] = Counter()
        self._results: dict[CameraKey, _Results] = {}
        self._returned: dict[CameraKey, list[StreamReturn[Any]]] = {}

    def streams(self) -> list[StreamStatus]:
        """Return the status of each offered stream."""
        return [offer.forward.status() for _, offer in sorted(self._offers.items(), key=_by_key) if offer.forward]

    def withdrawn(self) -> Counter[str]:
        """Return the counts of dropped messages of withdrawn streams, by reason."""
        return +self._withdrawn

    def returns(self) -> list[ReturnStatus]:
        """Return the status of each returned result."""
        return [returned.status() for _, results in sorted(self._results.items()) for returned in results.returns]

    async def change(self, plan: Plan) -> None:
        """Withdraw streams that are not planned, then offer the planned ones. One call at a time."""
        await self._withdraw(
            key
            for key, offer in self._offers.items()
            if key not in plan.streams or (plan.streams[key].topic, plan.kind_of(key)) != (offer.topic, offer.kind)
        )
        await self._end_results(
            camera
            for camera, results in list(self._results.items())
            if camera not in plan.cameras or results.streams != self._returnable(camera, plan)
        )
        for key, source in plan.streams.items():
            if key not in self._offers:
                self._offer(key, source.topic, plan.kind_of(key))
        self._begin_results(plan)
        for offer in self._offers.values():
            await offer.offered.wait()

    async def close(self) -> None:
        """Withdraw everything."""
        await self.change(NO_PLAN)

    def _offer(self, key: SensorKey, topic: str, kind: StreamKind) -> None:
        if key not in self._streams:
            self._streams[key] = StreamForward(
                key, topic, kind, self._boot_id, self._shaping.rate_limiter(key), useful=self._shaping.useful(key)
            )
        stream = self._streams[key]
        self._withdrawn -= stream.dropped()
        stream.topic, stream.kind = topic, kind
        offered = asyncio.Event()
        task = self._group.create_task(self._run(key, stream, offered))
        self._offers[key] = _Offer(task, topic, kind, offered)

    async def _run(self, key: SensorKey, stream: StreamForward, offered: asyncio.Event) -> None:
        async with offering(self._bus, stream, self._shaping.output) as forward:
            self._offers[key].forward = forward
            offered.set()
            await forward.run(self.topics)

    async def _withdraw(self, keys: Iterable[SensorKey]) -> None:
        ending = {key: self._offers[key] for key in keys}
        await cancel_and_wait({offer.task for offer in ending.values()})
        for key, offer in ending.items():
            if offer.forward is not None:
                said = offer.forward.status()
                offer.forward.retire()
                log.info("%s: withdrawn after %d messages, %d forwarded", key, said.received, said.forwarded)
            del self._offers[key]
            self._withdrawn += self._streams[key].dropped()

    def _begin_results(self, plan: Plan) -> None:
        new = [camera for camera in plan.cameras if camera not in self._results]
        room = max(0, MAX_RETURNED - len(self._results))
        for camera in new[:room]:
            self._return(camera, plan)
        if left := len(new[room:]):
            log.warning("results are returned for %d cameras, not for %d more", MAX_RETURNED, left)

    def _return(self, camera: CameraKey, plan: Plan) -> None:
        if camera not in self._returned:
            root = result_root(camera.camera, first=camera.camera == plan.first)
            self._returned[camera] = self._returned_for(camera, root)
        streams = self._returnable(camera, plan)
        for stream in self._returned[camera]:
            if stream not in streams:
                log.warning("%s is not returned: %s is a sensor's topic", stream.key, ", ".join(stream.topics.values()))
        returns = [Return(stream) for stream in streams]
        tasks = {self._group.create_task(returned.run(self._node, self._bus)) for returned in returns}
        self._results[camera] = _Results(streams, returns, tasks)

    def _returnable(self, camera: CameraKey, plan: Plan) -> list[StreamReturn[Any]]:
        """Return a camera's results without those that remapping turns into sensors' topics."""
        taken = {source.topic for source in plan.streams.values()}
        return [stream for stream in self._returned[camera] if taken.isdisjoint(stream.topics.values())]

    async def _end_results(self, cameras: Iterable[CameraKey]) -> None:
        ending = [self._results.pop(camera) for camera in cameras]
        await cancel_and_wait({task for results in ending for task in results.tasks})


def _by_key(item: tuple[SensorKey, _Offer]) -> str:
    return str(item[0])
