"""Results about space for tests, and what the rules say."""

import struct
import time

from schemas.alerts import Action, Alert, AlertState, Severity
from schemas.distances import Distances, Measured, ObjectDistance, Place
from schemas.objects import ObjectCloud, ObjectClouds, Shape, UprightBox
from schemas.transforms import Transform
from tests.schemas.frames import header

SHAPE = Shape(centroid=(0.5, 0.25, 2.0), box=UprightBox(centre=(0.5, 0.25, 2.0), size=(0.5, 0.25, 0.75), yaw=0.5))
TARGET = Transform(
    frame_id="map",
    child_frame_id="camera_color_optical_frame",
    stamp_ns=5,
    translation=(1.0, 2.0, 0.5),
    rotation=(0.0, 0.0, 0.0, 1.0),
)


def known(name: str, axial_m: float, index: int = 0) -> ObjectDistance:
    places = [
        Place(frame_id="camera_color_optical_frame", at=(0.5, 0.25, axial_m)),
        Place(frame_id="map", unknown="no transform from base_link to map at the stamp"),
    ]
    measured = Measured(
        axial_m=axial_m,
        euclidean_m=axial_m + 0.125,
        mean_m=axial_m + 0.5,
        nearest_m=axial_m,
        spread_m=0.0625,
        places=places,
    )
    return ObjectDistance(name=name, index=index, track=7, valid_share=0.75, measured=measured)


def unknown(name: str, index: int = 0) -> ObjectDistance:
    return ObjectDistance(name=name, index=index, valid_share=0, unknown="no depth image of its instant")


def distances(*objects: ObjectDistance, seq: int = 0, camera: str = "front") -> Distances:
    return Distances(header=header(seq=seq, camera=camera), objects=list(objects), model="m", worker="w")


def cloud(
    *points: tuple[float, float, float], rgb: bytes = b"", name: str = "box", label: int = 1, index: int = 0
) -> ObjectCloud:
    xyz = struct.pack(f"<{3 * len(points)}f", *(number for point in points for number in point))
    return ObjectCloud(
        name=name, label=label, index=index, xyz=memoryview(xyz), rgb=memoryview(rgb), shape=SHAPE, in_target=SHAPE
    )


def clouds(*objects: ObjectCloud, seq: int = 0, camera: str = "front") -> ObjectClouds:
    return ObjectClouds(
        header=header(seq=seq, camera=camera),
        objects=list(objects),
        model="m",
        worker="w",
        target=TARGET,
        unmeasured={3: "no points within its mask"},
    )


def alert(
    *,
    id_: str = "a1",
    state: AlertState = AlertState.RAISED,
    changed_ns: int = 5,
    robot: str = "r1",
    text: str = "near",
) -> Alert:
    return Alert(
        id=id_,
        rule="too near",
        severity=Severity.WARNING,
        state=state,
        robot=robot,
        camera="front",
        name="forklift",
        text=text,
        raised_ns=5,
        changed_ns=changed_ns,
    )


def action(*, id_: str = "1", name: str = "pick_up", payload: str = "box", robot: str = "r1") -> Action:
    """Return an action that is sent now."""
    return Action(id=id_, name=name, robot=robot, payload=payload, rule="box in view", sent_ns=time.time_ns())
