"""What a gateway returns to ROS for each camera."""

from typing import Any

from gateway.outgoing.stream import StreamReturn
from gateway.outgoing.translators import RETURNED
from schemas.keys import CameraKey


def camera_returns(camera: CameraKey, root: str) -> list[StreamReturn[Any]]:
    """Return every stream that a gateway returns for a camera; `root` is the camera's result namespace on ROS."""
    return [StreamReturn(camera, root, translator) for translator in RETURNED]
