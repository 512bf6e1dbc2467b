"""Connects all shaping of one gateway process."""

import asyncio
import logging
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial

from bus import Bus, Publisher
from gateway.to_bus.shaping.compression import NONE
from gateway.to_bus.shaping.consumers import Consumers
from gateway.to_bus.shaping.encoder_pool import EncoderPool
from gateway.to_bus.shaping.frame_rates import Instants, StreamRate
from gateway.to_bus.shaping.settings import FRAMES, IMAGES, ShapingSettings
from gateway.to_bus.shaping.stream_output import OutputPlan, StreamOutput
from gateway.to_bus.shaping.uplink import Moment
from gateway.to_bus.shaping.uplink_pacer import Pacer
from gateway.to_bus.translators import kind_of
from schemas.header import Header
from schemas.keys import ROS, CameraKey, RobotStreamKey, SensorKey, Stream, StreamKey

log = logging.getLogger(__name__)

_SCALED_LIKE = {Stream.INFO: Stream.COLOR, Stream.DEPTH_INFO: Stream.DEPTH}


@dataclass(slots=True)
class _Shared:
    """State shared by a camera's streams: instants for their rates, and moments for the uplink.

    outputs: how many are open.
    """

    picked: Instants = field(default_factory=Instants)
    paced: Instants = field(default_factory=Instants)
    outputs: int = 0


class Shaping:
    """State shared by a gateway's streams: each camera's instants, the encoder pool, the uplink and consumers.

    A camera's instants are there while one of its outputs is open: names of cameras come and go with a robot's nodes.
    """

    def __init__(self, settings: ShapingSettings, consumers: Consumers) -> None:
        self._settings = settings
        self._consumers = consumers
        self._shared: defaultdict[CameraKey | RobotStreamKey, _Shared] = defaultdict(_Shared)
        self._encoder_pool = EncoderPool()
        self._pacer = None if settings.uplink_mbit is None else Pacer(settings.uplink_mbit)

    def rate_limiter(self, key: SensorKey) -> StreamRate | None:
        """Return the rate limiter of a stream; None if none of its messages may be dropped."""
        if not kind_of(key).is_droppable:
            return None
        sharing = _sharing(key)
        return StreamRate(lambda: self._shared[sharing].picked, key.stream, self._settings.max_hz_of(key.name))

    def useful(self, key: SensorKey) -> Callable[[int], bool]:
        """Return a predicate: can a consumer use a stream's frame that arrives at a time, in ns since the epoch?"""
        if not isinstance(key, StreamKey):
            return lambda _: True
        return lambda now_ns: self._consumers.passes(key, now_ns)

    @contextmanager
    def output(self, key: SensorKey, publisher: Publisher) -> Iterator[StreamOutput]:
        """Return the output of a stream's messages to its publisher."""
        output = StreamOutput(key, publisher, self._plan(key), self._encoder_pool, self._pacer)
        shared = self._shared[_sharing(key)]
        shared.outputs += 1
        try:
            yield output
        finally:
            output.close()
            shared.outputs -= 1
            if not shared.outputs:
                self._forget(_sharing(key))

    def _forget(self, sharing: CameraKey | RobotStreamKey) -> None:
        shared = self._shared.pop(sharing)
        if self._pacer is not None:
            self._pacer.forget_moments(shared.paced)

    def _plan(self, key: SensorKey) -> OutputPlan:
        if not isinstance(key, StreamKey):
            if key.kind == ROS and self._settings.privacy_mask:
                log.warning("%s: sent as it is: --privacy-mask is for cameras' images", key)
            return OutputPlan(all_here=partial(self._consumers.all_here, key), droppable=kind_of(key).is_droppable)
        images = (StreamKey(key.camera, each).name for each in IMAGES)
        if key.stream is Stream.POINTS and any(map(self._settings.private_areas_of, images)):
            log.warning("%s: points are sent as they are: --privacy-mask is for images; --deny keeps them here", key)
        scaled_like = StreamKey(key.camera, _SCALED_LIKE.get(key.stream, key.stream))
        return OutputPlan(
            factor=1 if key.stream is Stream.POINTS else self._settings.factor_of(scaled_like.name),
            method=self._settings.method_of(key.name) if key.stream in FRAMES else NONE,
            private=self._settings.private_areas_of(key.name) if key.stream in IMAGES else (),
            all_here=partial(self._consumers.all_here, key),
            droppable=kind_of(key).is_droppable,
            moment_of=self._moment_of(key),
        )

    def _moment_of(self, key: StreamKey) -> Callable[[Header], Moment | None]:
        return lambda header: self._shared[key.camera].paced.moment(key.stream, header.stamp_ns, header.received_ns)

    async def run(self, bus: Bus) -> None:
        """Run the encoder pool and the pacer, forever."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._consumers.follow(bus))
            group.create_task(self._encoder_pool.run())
            if self._pacer is not None:
                group.create_task(self._pacer.run())


def _sharing(key: SensorKey) -> CameraKey | RobotStreamKey:
    """Return the owner of a stream's instants: its camera or the stream itself."""
    return key.camera if isinstance(key, StreamKey) else key
