"""Class lists and inventories for tests."""

from collections.abc import Mapping

from schemas.detections import ClassCount, ClassList
from schemas.header import Header
from schemas.keys import CameraKey
from services.monitor.inventory.inventory import Inventory
from services.monitor.inventory.sighting import Sighting

FRONT = CameraKey("r1", "front")
S = 1_000_000_000


def seen(
    seq: int,
    counts: Mapping[str, int],
    *,
    key: CameraKey = FRONT,
    boot_id: str = "boot",
    model: str = "m",
    score: float = 0.5,
) -> ClassList:
    """Return a camera's class list."""
    return ClassList(
        header=Header(
            robot=key.robot,
            camera=key.camera,
            boot_id=boot_id,
            seq=seq,
            stamp_ns=seq,
            frame_id="camera",
            received_ns=seq,
        ),
        classes=[ClassCount(name, count, score) for name, count in counts.items()],
        model=model,
        worker="w",
    )


def going_on(inventory: Inventory) -> list[Sighting]:
    """Return the sightings that go on as far as anybody knows."""
    cameras = [camera for camera in inventory.cameras() if not camera.lost]
    return [sighting for camera in cameras for sighting in camera.sightings() if sighting.count]
