"""Sends what a stolen certificate, or an open port, lets somebody send: as fast as the link takes it.

Command line: kind of flood (see FLOODS), the router's endpoint, seconds, and how many messages at least. Prints how
much it sent.
"""

import itertools
import json
import sys
import time
from collections.abc import Callable, Iterator
from typing import Final

import zenoh

from bus.session.config import session_config
from bus.settings import BusSettings
from schemas import codec, keys, worker_keys
from schemas.detections import ClassCount, ClassList
from schemas.header import MAX_LABEL, Header
from schemas.keys import CameraKey, Stream
from schemas.status import CameraLoad, GatewayStatus, StreamStatus, WorkerStatus
from schemas.world import SiteStatus

Message = tuple[str, ClassList | GatewayStatus | WorkerStatus | SiteStatus]

NAMES: Final = 20_500
"""More than the monitor follows."""

CAMERAS: Final = 200
CLASSES: Final = 900
"""With the longest names, a list of so many just fits into what is read."""

ROBOTS: Final = 2_000


def class_list(key: CameraKey, seq: int, names: Iterator[str]) -> ClassList:
    """Return a list of classes, each once."""
    now_ns = time.time_ns()
    header = Header(
        robot=key.robot,
        camera=key.camera,
        boot_id="flood",
        seq=seq,
        stamp_ns=now_ns,
        frame_id="",
        received_ns=now_ns,
    )
    return ClassList(header=header, classes=[ClassCount(name, 1, 0.5) for name in names], model="m", worker="w")


def named(robot: int, camera: str = "front") -> CameraKey:
    """Return an invented camera."""
    return CameraKey(f"invented{robot}", camera)


def names() -> Iterator[Message]:
    """Yield one list of each of more cameras than are followed, over and over."""
    for seq in itertools.count():
        for number in range(NAMES):
            key = named(number)
            yield key.stream(Stream.CLASSES), class_list(key, seq, iter(["box"]))


def robot() -> Iterator[Message]:
    """Yield small lists of one robot's cameras."""
    for seq in itertools.count():
        for number in range(CAMERAS):
            key = named(0, f"c{number}")
            yield key.stream(Stream.CLASSES), class_list(key, seq, iter(["box"]))


def lists() -> Iterator[Message]:
    """Yield the largest lists, of ever new classes, of some cameras."""
    numbers = itertools.count()
    for seq in itertools.count():
        for camera in range(CAMERAS):
            key = named(camera)
            longest = (f"{next(numbers):0{MAX_LABEL}}" for _ in range(CLASSES))
            yield key.stream(Stream.CLASSES), class_list(key, seq, longest)


def statuses() -> Iterator[Message]:
    """Yield large statuses of many gateways."""
    longest = "x" * MAX_LABEL
    streams = [
        StreamStatus(
            camera="front",
            stream=longest,
            topic=longest,
            wanted=True,
            publishers=1,
            received=number,
            forwarded=number,
            problem=longest,
        )
        for number in range(900)
    ]
    for number in itertools.cycle(range(ROBOTS)):
        robot = named(number).robot
        status = GatewayStatus(robot=robot, boot_id="b", clock_id="c", sent_ns=time.time_ns(), streams=streams)
        yield keys.gateway_status(robot), status


def workers() -> Iterator[Message]:
    """Yield large statuses of many workers."""
    loads = [
        CameraLoad(robot="r1", camera=f"c{number}", inferred=number, dropped={f"{number:0128}": 1}, serving=True)
        for number in range(900)
    ]
    classes = [f"{number:0{MAX_LABEL}}" for number in range(900)]
    for number in itertools.cycle(range(ROBOTS)):
        worker = named(number).robot
        status = WorkerStatus(
            service="detector", worker=worker, model="m", sent_ns=time.time_ns(), cameras=loads, classes=classes
        )
        yield worker_keys.worker_status("detector", worker), status


FLOODS: Final[dict[str, Callable[[], Iterator[Message]]]] = {
    "names": names,
    "robot": robot,
    "lists": lists,
    "statuses": statuses,
    "workers": workers,
}


def main() -> None:
    """Flood."""
    kind, endpoint, seconds, least = sys.argv[1], sys.argv[2], float(sys.argv[3]), int(sys.argv[4])
    settings = BusSettings(connect=[endpoint], shared_memory=False)
    sent = size = 0
    with zenoh.open(zenoh.Config.from_json5(json.dumps(session_config(settings)))) as session:
        until_s = time.monotonic() + seconds
        for key, message in FLOODS[kind]():
            payload = codec.encode(message)
            session.put(
                key,
                payload,
                encoding=codec.encoding(type(message)),
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
            sent, size = sent + 1, size + len(payload)
            if time.monotonic() > until_s and sent >= least:
                break
    print(json.dumps({"sent": sent, "sent_mb": round(size / 2**20, 1)}), flush=True)


if __name__ == "__main__":
    main()
