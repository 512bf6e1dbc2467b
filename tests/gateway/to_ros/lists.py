"""Class lists for tests."""

import msgspec

from schemas.detections import ClassCount, ClassList
from tests.schemas.frames import header


def class_list(*counts: tuple[str, int], seq: int = 0, boot_id: str = "boot", camera: str = "front") -> ClassList:
    return ClassList(
        header=msgspec.structs.replace(header(seq=seq, camera=camera), boot_id=boot_id),
        classes=[ClassCount(name, count, 0.5) for name, count in counts],
        model="m",
        worker="w",
    )
