"""A subscriber to all class lists that notes when each came, and reads them later."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager

import zenoh
from zenoh.handlers import Callback

from benchmarks.scaling.results import Log, Result
from bus import BusSettings
from bus.session.config import session_config
from schemas import codec, keys
from schemas.detections import ClassList
from schemas.keys import Stream


class Observer:
    """What came so far."""

    def __init__(self) -> None:
        self._arrived: list[tuple[float, bytes]] = []
        self._read: list[Result] = []

    def take(self, sample: zenoh.Sample) -> None:
        """Note a class list, on Zenoh's thread."""
        self._arrived.append((time.time(), sample.payload.to_bytes()))

    def log(self) -> Log:
        """Return all that came."""
        arrived, self._arrived = self._arrived, []
        self._read.extend(_result(at_s, payload) for at_s, payload in arrived)
        return Log(self._read)


def _result(at_s: float, payload: bytes) -> Result:
    seen = codec.decode(ClassList, payload, codec.encoding(ClassList))
    camera = f"{seen.header.robot}/{seen.header.camera}"
    frame = camera, seen.header.boot_id, seen.header.seq
    return Result(at_s, camera, seen.worker, frame, at_s - seen.header.received_ns / 1e9)


@contextmanager
def observing(router: str) -> Iterator[Observer]:
    """Subscribe for as long as the context lasts."""
    settings = BusSettings(connect=[router], shared_memory=False)
    observer = Observer()
    with zenoh.open(zenoh.Config.from_json5(json.dumps(session_config(settings)))) as session:
        session.declare_subscriber(keys.every_stream(Stream.CLASSES), Callback(observer.take, indirect=False))
        yield observer
