"""Messages of the world for tests."""

import struct

from schemas.distances import REACHES, CameraView, DepthGrid, ViewedObject
from schemas.world import (
    ChangeKind,
    FloorLooks,
    NearbyObjects,
    RobotOffset,
    Seer,
    SiteStatus,
    WorldAnswer,
    WorldChange,
    WorldChanges,
    WorldObject,
    WorldRequest,
)
from tests.schemas.frames import header

OBJECT = WorldObject(
    id="a1-7",
    site="hall-2",
    name="pallet",
    at=(4.0, -2.5, 0.5),
    covariance=(0.25, 0.0, 0.0, 0.25, 0.0, 0.5),
    size=(1.25, 0.75, 1.0),
    yaw=0.5,
    existence=0.875,
    first_ns=5,
    last_ns=9,
    looked_ns=11,
    seen_by=[Seer(robot="r1", camera="front", last_ns=9)],
    sightings=12,
    velocity=(0.5, 0.0),
)
CHANGE = WorldChange(kind=ChangeKind.MOVED, at_ns=9, object=OBJECT, before=(4.0, -1.5, 0.5), by="r1")
CHANGES = WorldChanges(site="hall-2", epoch="e", first=3, sent_ns=10, changes=[CHANGE])
ANSWER = WorldAnswer(site="hall-2", epoch="e", last=3, now_ns=10, objects=[OBJECT], complete=False)
REQUEST = WorldRequest(name="pallet", region=[(0, 0), (5, 0), (5, 5)], seen_within_s=60, least_existence=0.5)
NEARBY = NearbyObjects(robot="r1", site="hall-2", frame_id="map", sent_ns=10, radius_m=8, objects=[OBJECT])
STATUS = SiteStatus(
    site="hall-2",
    epoch="e",
    worker="w",
    sent_ns=10,
    last=3,
    objects={"pallet": 1},
    tentative=2,
    views=3,
    sightings=4,
    left_out={"too far": 1},
    robots=[RobotOffset(robot="r1", x=0.125, y=0.0, yaw=0.0, sigma_m=0.0625, doubted="it is lost", views=3, last_ns=9)],
    problems=["r2: no map frame"],
)
FLOOR = FloorLooks(
    site="hall-2",
    now_ns=10,
    origin=(-1.0, -2.0),
    cell_m=0.5,
    columns=2,
    rows=1,
    ages=memoryview(struct.pack("<2H", 3, 65535)),
)


def viewed(name: str = "pallet", at: tuple[float, float, float] = (2.0, 0.5, 0.25)) -> ViewedObject:
    return ViewedObject(
        name=name,
        score=0.75,
        index=0,
        track=7,
        box=(10.0, 8.0, 14.0, 12.0),
        depth_m=2.0,
        spread_m=0.0625,
        at=at,
        reach_mm=[500] * REACHES,
        low_m=0.0,
        high_m=1.0,
    )


def grid(columns: int = 3, rows: int = 2, *, near_mm: int = 2000, far_mm: int = 2500) -> DepthGrid:
    near, far = (struct.pack(f"<{columns * rows}H", *[each] * (columns * rows)) for each in (near_mm, far_mm))
    return DepthGrid(
        columns=columns,
        rows=rows,
        fx=2.5,
        fy=2.5,
        cx=1.5,
        cy=1.0,
        near_mm=memoryview(near),
        far_mm=memoryview(far),
    )


def view(*objects: ViewedObject) -> CameraView:
    return CameraView(
        header=header(),
        frame_id="map",
        position=(0.0, 0.0, 1.0),
        rotation=(0.5, -0.5, 0.5, -0.5),
        speed=0.5,
        grid=grid(),
        objects=list(objects),
        unmeasured={"box": 1},
        model="m",
        worker="w",
    )
