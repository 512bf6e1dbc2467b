"""Published ROS topics, as a master knows them."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gateway.nodes import is_gateway

MAX_TOPIC: Final = 256
TOPIC: Final = re.compile(r"/[A-Za-z][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*")
TRANSPORTS: Final = ("compressed", "compressedDepth")


@dataclass(frozen=True, slots=True, order=True)
class Topic:
    """A published topic.

    type, and encoding of an image's pixels or of the picture in a cloud: empty while it is not known.
    """

    name: str
    type: str
    publishers: tuple[str, ...]
    encoding: str = ""

    @property
    def only_gateways(self) -> bool:
        """Whether no sensor publishes it."""
        return all(is_gateway(node) for node in self.publishers)


def is_topic(name: str) -> bool:
    """Whether this is a global topic's name that the contract can carry."""
    return len(name) <= MAX_TOPIC and TOPIC.fullmatch(name) is not None


def image_of(name: str) -> str:
    """Return the topic of which this one is a compressed form; its own name if it is none."""
    image, _, transport = name.rpartition("/")
    return image if image and transport in TRANSPORTS else name


def calibrations_of(name: str) -> tuple[str, str]:
    """Return where ROS's conventions put the calibration of an image: beside it, or beside the left one of two."""
    space = image_of(name).rpartition("/")[0]
    return f"{space}/camera_info", f"{space}/left/camera_info"


def topics_of(publishers: Mapping[str, tuple[str, ...]], types: Mapping[str, str]) -> list[Topic]:
    """Return what is published, given the names of publishing nodes and of message types by topic."""
    known = {name: kind for name, kind in types.items() if kind != "*"}
    return [Topic(name, known.get(name, ""), tuple(sorted(nodes))) for name, nodes in sorted(publishers.items())]
