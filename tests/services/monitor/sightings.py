"""A fleet of one robot, its class lists and its status."""

import msgspec

from schemas.detections import ClassCount, ClassList
from schemas.keys import CameraKey
from schemas.status import GatewayStatus
from services.monitor.fleet import Fleet
from tests.schemas.frames import header

FRONT = CameraKey("r1", "front")


CLOCK = "this machine"
S = 1_000_000_000


def seen(seq: int = 0, *, robot: str = "r1", boot_id: str = "boot", box: int = 1) -> ClassList:
    about = msgspec.structs.replace(header(robot=robot, seq=seq), boot_id=boot_id)
    return ClassList(header=about, classes=[ClassCount("box", box, 0.9)], model="m", worker="w")


def status(clock_id: str = CLOCK, robot: str = "r1") -> GatewayStatus:
    return GatewayStatus(robot=robot, boot_id="boot", clock_id=clock_id, sent_ns=0)


def online_fleet() -> Fleet:
    fleet = Fleet(CLOCK)
    fleet.robot_presence("r1", alive=True)
    fleet.camera_presence(FRONT, alive=True)
    fleet.gateway_status(status(), 0)
    return fleet
