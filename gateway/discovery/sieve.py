"""Which topics discovery looks at, and why not at the others."""

from collections.abc import Collection
from typing import Final

from gateway.discovery.candidates import READERS
from gateway.discovery.topics import Topic, image_of, is_topic
from gateway.discovery.wishes import Wishes
from gateway.outgoing.topics import is_result
from gateway.translators import camera_info, transforms
from gateway.translators.raw import STRING

NOT_A_NAME: Final = "no name that a stream's topic can have"
OF_GATEWAYS: Final = "published by gateways"
UNKNOWN_TYPE: Final = "of a type that the master does not know yet"
TEXT: Final = "a text; --discover --topics text/NAME=TOPIC takes it as well"
NO_SENSOR: Final = "of no type that sensors have; --discover --topics ros/NAME=TOPIC takes it as well, as it is"

TYPES: Final = READERS.keys() | {camera_info.TYPE_NAME, *transforms.TYPE_NAMES}


def why_not(topic: Topic, wishes: Wishes, named: Collection[str]) -> str | None:
    """Return why discovery does not look at a topic; None when it does. `named`: images that the settings name."""
    if not is_topic(topic.name):
        return NOT_A_NAME
    if topic.only_gateways or is_result(topic.name):
        return OF_GATEWAYS
    if image_of(topic.name) in named:
        return "the same image as a topic that the settings name"
    return _by_pattern(topic, wishes) or _by_type(topic)


def _by_pattern(topic: Topic, wishes: Wishes) -> str | None:
    if wishes.deny.fullmatch(topic.name):
        return f"denied by --deny {wishes.deny.pattern}"
    if not wishes.allow.fullmatch(topic.name):
        return f"not allowed by --allow {wishes.allow.pattern}"
    return None


def _by_type(topic: Topic) -> str | None:
    if not topic.type:
        return UNKNOWN_TYPE
    if topic.type == STRING:
        return TEXT
    return None if topic.type in TYPES else NO_SENSOR
