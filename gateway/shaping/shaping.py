"""All shaping of one gateway process."""

import asyncio
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from bus import Bus, Publisher, QoS
from gateway.shaping.compression import NONE
from gateway.shaping.consumers import Consumers
from gateway.shaping.instants import Instants, Thinning
from gateway.shaping.outlet import Outlet, Plan
from gateway.shaping.pacer import Pacer
from gateway.shaping.settings import FRAMES, ShapingSettings
from gateway.shaping.uplink import Moment
from gateway.shaping.workshop import Workshop
from gateway.translators import kind_of
from schemas.header import Header
from schemas.keys import CameraKey, SensorKey, Stream, StreamKey

_SCALED_LIKE = {Stream.INFO: Stream.COLOR, Stream.DEPTH_INFO: Stream.DEPTH}


class Shaping:
    """What the streams of one gateway share: each camera's instants, the workshop, the uplink, and who listens."""

    def __init__(self, settings: ShapingSettings, consumers: Consumers) -> None:
        self._settings = settings
        self._consumers = consumers
        self._instants: defaultdict[CameraKey | str, Instants] = defaultdict(Instants)
        self._paced: defaultdict[CameraKey, Instants] = defaultdict(Instants)
        self._workshop = Workshop()
        self._pacer = None if settings.uplink_mbit is None else Pacer(settings.uplink_mbit)

    def thinning(self, key: SensorKey) -> Thinning | None:
        """Return what leaves out a stream's frames beyond its rate; None where nothing ever may be."""
        if kind_of(key).qos is not QoS.IMAGE:
            return None
        camera = key.camera if isinstance(key, StreamKey) else str(key)
        return Thinning(self._instants[camera], key.stream, self._settings.max_hz_of(key.name))

    def useful(self, key: SensorKey) -> Callable[[int], bool]:
        """Return what tells whether a stream's frame that is here at a time, in ns since the epoch, can be used."""
        if not isinstance(key, StreamKey):
            return lambda _: True
        return lambda now_ns: self._consumers.passes(key, now_ns)

    @contextmanager
    def outlet(self, key: SensorKey, publisher: Publisher) -> Iterator[Outlet]:
        """Open the way of a stream's messages to its publisher."""
        outlet = Outlet(key, publisher, self._plan(key), self._workshop, self._pacer)
        try:
            yield outlet
        finally:
            outlet.close()

    def _plan(self, key: SensorKey) -> Plan:
        if not isinstance(key, StreamKey):
            return Plan(all_here=partial(self._consumers.all_here, key), droppable=kind_of(key).qos is QoS.IMAGE)
        scaled_like = StreamKey(key.camera, _SCALED_LIKE.get(key.stream, key.stream))
        return Plan(
            factor=1 if key.stream is Stream.POINTS else self._settings.factor_of(scaled_like.name),
            method=self._settings.method_of(key.name) if key.stream in FRAMES else NONE,
            all_here=partial(self._consumers.all_here, key),
            droppable=kind_of(key).qos is QoS.IMAGE,
            moment_of=self._moment_of(key),
        )

    def _moment_of(self, key: StreamKey) -> Callable[[Header], Moment | None]:
        instants = self._paced[key.camera]
        return lambda header: instants.moment(key.stream, header.stamp_ns, header.received_ns)

    async def run(self, bus: Bus) -> None:
        """Do what outlets leave to be done, for ever."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._consumers.follow(bus))
            group.create_task(self._workshop.run())
            if self._pacer is not None:
                group.create_task(self._pacer.run())
