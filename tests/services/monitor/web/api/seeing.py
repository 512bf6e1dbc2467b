"""A fleet of two robots, one of them with an odd class in view, in a monitor's memory."""

import time

import msgspec

from schemas.detections import ClassCount, ClassList
from schemas.keys import CameraKey
from schemas.status import CameraLoad, GatewayStatus, StreamStatus, WorkerStatus
from services.monitor.fleet import Fleet
from tests.schemas.frames import header

ODD = '<img src=x onerror="alert(1)">\u2028\n"}'
FRONT = CameraKey("r1", "front")


def fill(fleet: Fleet) -> None:
    """Have r1 see two objects of an odd class with its camera, and r2 be gone."""
    now_ns = time.time_ns()
    for robot in ("r1", "r2"):
        fleet.robot_presence(robot, alive=robot == "r1")
        fleet.camera_presence(CameraKey(robot, "front"), alive=robot == "r1")
    stream = StreamStatus(
        camera="front", stream="color", topic=ODD, wanted=True, publishers=1, received=9, forwarded=5, dropped={ODD: 4}
    )
    gateway = GatewayStatus(
        robot="r1",
        boot_id="b",
        clock_id="clock",
        sent_ns=now_ns,
        waiting_for=ODD,
        streams=[stream],
        withdrawn={"w": 1},
        version=ODD,
    )
    fleet.gateway_status(gateway, now_ns)
    load = CameraLoad(robot="r1", camera="front", inferred=5, dropped={"late": 2}, serving=True, budget_hz=2.5)
    worker = WorkerStatus(
        service="detector",
        worker="w1",
        model=ODD,
        sent_ns=now_ns,
        cameras=[load],
        remarks=[ODD],
        version="0.9",
        runtime="openvino-int8",
        busy_s=1.5,
    )
    fleet.worker_status(worker, now_ns)
    see(fleet, 0, 2)
    see(fleet, 1, 2)


def see(fleet: Fleet, seq: int, count: int) -> None:
    """Have r1's camera see so many of the odd class."""
    now_ns = time.time_ns()
    head = msgspec.structs.replace(header(seq=seq), received_ns=now_ns)
    seen = ClassList(header=head, classes=[ClassCount(ODD, count, 0.5)] * bool(count), model="m", worker="w")
    fleet.see(seen, time.monotonic(), now_ns)
