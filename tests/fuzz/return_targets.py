"""The fleet's results on their way back to ROS."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from gateway.outgoing.stream import StreamReturn
from gateway.outgoing.translators import RETURNED
from schemas import codec
from schemas.keys import CameraKey
from tests.fuzz.target import LeftOutError, Target
from tests.gateway.outgoing.lists import class_list

if TYPE_CHECKING:
    from random import Random

SEED = codec.encode(class_list(("box", 2), ("pallet", 1)))


def feed(translator: Any, data: bytes, _rng: Random) -> None:
    stream = StreamReturn(CameraKey("r1", "front"), "/ultralytics", translator)
    if stream.take(data, codec.encoding(translator.schema), 0) is None:
        raise LeftOutError


TARGETS = [Target(f"return of {each.topic}", [SEED], partial(feed, each), (LeftOutError,)) for each in RETURNED]
