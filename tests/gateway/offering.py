"""What a gateway offers, for tests: nothing is shaped, and everything is returned."""

import asyncio
from collections.abc import Callable
from typing import Any

from bus import Bus
from gateway.offers import Offers
from gateway.ros1.node import Node
from gateway.to_bus.shaping.consumers import Consumers
from gateway.to_bus.shaping.settings import ShapingSettings
from gateway.to_bus.shaping.shaping import Shaping
from gateway.to_ros.outputs import camera_returns
from gateway.to_ros.stream import StreamReturn
from schemas.keys import CameraKey
from tests.gateway.to_ros.namespaces import IN_ROOT

Returned = Callable[[CameraKey, str], list[StreamReturn[Any]]]


def returned_in_root(camera: CameraKey, root: str) -> list[StreamReturn[Any]]:
    return camera_returns(camera, root, IN_ROOT)


def new_offers(group: asyncio.TaskGroup, bus: Bus, node: Node, returned: Returned = returned_in_root) -> Offers:
    shaping = Shaping(ShapingSettings.model_validate({"compression": "raw"}), Consumers("r1", "here", near=True))
    return Offers(
        group,
        bus,
        node,
        boot_id="boot",
        shaping=shaping,
        returned=returned,
    )
