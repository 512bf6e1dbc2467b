"""The fleet's results on their way back to ROS."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from schemas import codec
from tests.fuzz.target import LeftOutError, Target
from tests.fuzz.test_returns import RESULTS, stream_of
from tests.gateway.to_ros.taking import take

if TYPE_CHECKING:
    from random import Random


def feed(name: str, data: bytes, _rng: Random) -> None:
    if take(stream_of(name), data) is None:
        raise LeftOutError


TARGETS = [
    Target(f"return of {name}", [codec.encode(message)], partial(feed, name), (LeftOutError,))
    for name, message in RESULTS.items()
]
