"""Depth images of walls and boxes whose distances are known exactly, and what a detector says of them."""

from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.camera_info import CameraInfo
from schemas.detections import Box, Detection, Detections
from schemas.image import ImageFrame
from schemas.transforms import Transform, Transforms
from tests.schemas.frames import header
from tests.schemas.masks import coco_mask
from tests.services.geometry.cameras import info

FRAME = "camera_color_optical_frame"
HEIGHT, WIDTH, FOCAL = 48, 64, 50.0
PERIOD_NS = 33_000_000


def stamp_of(seq: int) -> int:
    return 1_700_000_000_000_000_000 + seq * PERIOD_NS


def head(seq: int = 0, *, frame_id: str = FRAME, stamp_ns: int | None = None, **more: Any) -> Any:
    stamp = stamp_of(seq) if stamp_ns is None else stamp_ns
    return msgspec.structs.replace(header(seq=seq, **more), stamp_ns=stamp, frame_id=frame_id)


def wall(z: float = 4.0) -> NDArray[np.float32]:
    return np.full((HEIGHT, WIDTH), z, np.float32)


def mask(rows: slice, columns: slice) -> NDArray[np.bool_]:
    made = np.zeros((HEIGHT, WIDTH), np.bool_)
    made[rows, columns] = True
    return made


def found(*masks: NDArray[np.bool_], names: tuple[str, ...] = ()) -> list[Detection]:
    names = names or ("box",) * len(masks)
    return [
        Detection(name=name, score=0.9, box=Box(0, 0, 1, 1), mask=coco_mask(each))
        for name, each in zip(names, masks, strict=True)
    ]


def detections(objects: list[Detection], seq: int = 0, **more: Any) -> Detections:
    return Detections(
        header=head(seq, **more), height=HEIGHT, width=WIDTH, objects=objects, model="m", worker="w", spans={"model": 7}
    )


def depth(metres: NDArray[np.float32], seq: int = 0, **more: Any) -> ImageFrame:
    """Return an image of whole millimetres; NaN becomes 0."""
    millimetres = np.nan_to_num(np.rint(metres * 1000)).astype(np.uint16)
    height, width = millimetres.shape
    return ImageFrame(
        header=head(seq, **more),
        height=height,
        width=width,
        encoding="16UC1",
        step=2 * width,
        data=memoryview(millimetres.tobytes()),
    )


def calibration(**more: Any) -> CameraInfo:
    return info(height=HEIGHT, width=WIDTH, **{"focal": FOCAL, **more})


def transforms(*said: tuple[str, str, float], stamp_ns: int = 0) -> Transforms:
    """Return transforms that move along x by so many metres."""
    made = [
        Transform(
            frame_id=parent, child_frame_id=child, stamp_ns=stamp_ns, translation=(x, 0.0, 0.0), rotation=(0, 0, 0, 1)
        )
        for parent, child, x in said
    ]
    return Transforms(header=head(stamp_ns=0, frame_id="", camera=""), transforms=made)
