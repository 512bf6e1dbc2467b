"""What gateways and detectors would publish of the simulated world."""

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from schemas.camera_info import CameraInfo
from schemas.detections import Box, Detection, Detections
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.points import PointCloud, PointField
from schemas.transforms import Transform, Transforms
from services.geometry.rotation import quaternion_of
from services.simulator.messages import DATATYPES
from services.simulator.placement import Placement
from services.simulator.world import CLASSES, Camera, SeenObject
from services.training.evaluation.truths import mask_of

STAMP_NS: Final = 1_700_000_000_000_000_000


def header(frame_id: str = "", stamp_ns: int = STAMP_NS) -> Header:
    """Return the header of a message of the one robot's one camera."""
    return Header(
        robot="r1", camera="camera", boot_id="b", seq=0, stamp_ns=stamp_ns, frame_id=frame_id, received_ns=stamp_ns
    )


def info_of(camera: Camera, head: Header) -> CameraInfo:
    """Return the calibration of a camera without distortion."""
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    return CameraInfo(
        header=head,
        height=camera.height,
        width=camera.width,
        distortion_model="plumb_bob",
        d=[0.0] * 5,
        k=[fx, 0, cx, 0, fy, cy, 0, 0, 1],
        r=[1, 0, 0, 0, 1, 0, 0, 0, 1],
        p=[fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0],
    )


def depth_of(millimetres: NDArray[np.uint16], head: Header) -> ImageFrame:
    """Return a depth image, height x width, 0 for no reading."""
    height, width = millimetres.shape
    data = memoryview(millimetres.tobytes())
    return ImageFrame(header=head, height=height, width=width, encoding="16UC1", step=2 * width, data=data)


def cloud_of(points: NDArray[Any], head: Header) -> PointCloud:
    """Return structured points, height x width, whose fields become the cloud's."""
    fields: Any = points.dtype.fields
    height, width = points.shape
    return PointCloud(
        header=head,
        height=height,
        width=width,
        fields=[PointField(name, offset, DATATYPES[kind.name]) for name, (kind, offset) in fields.items()],
        is_bigendian=False,
        point_step=points.itemsize,
        row_step=width * points.itemsize,
        data=memoryview(points.tobytes()),
        is_dense=False,
    )


def transforms_of(joints: Iterable[tuple[str, str, Placement]], stamp_ns: int = STAMP_NS) -> Transforms:
    """Return (parent, child, where the child is in it) as one message."""
    made = [
        Transform(
            frame_id=parent,
            child_frame_id=child,
            stamp_ns=stamp_ns,
            translation=tuple(placement[:3, 3].tolist()),
            rotation=tuple(quaternion_of(placement).tolist()),
        )
        for parent, child, placement in joints
    ]
    return Transforms(header=header(), transforms=made)


def true_detections(objects: Sequence[SeenObject]) -> list[Detection]:
    """Return objects as a model without faults would."""
    return [_true_detection(seen) for seen in objects]


def _true_detection(seen: SeenObject) -> Detection:
    height, width = seen.mask.shape
    return Detection(
        name=seen.name,
        label=CLASSES.index(seen.name),
        score=1.0,
        box=Box(seen.left, seen.top, seen.left + width, seen.top + height),
        mask=mask_of(seen),
    )


def detections_of(objects: Sequence[Detection], camera: Camera, head: Header) -> Detections:
    """Return what was found in a picture of the camera."""
    return Detections(
        header=head, height=camera.height, width=camera.width, objects=list(objects), model="m", worker="w"
    )
