"""RateBudget: the number of frames of a camera that a consumer can use."""

import math
from typing import Annotated, Final

import msgspec

from schemas.errors import SchemaError
from schemas.header import Label, Name

LEAST_HZ: Final = 0.001
MOST_WAIT_S: Final = 3600.0


class RateBudget(msgspec.Struct, frozen=True, kw_only=True):
    """A rate limit that a slow consumer asks of a camera's gateway. Its newest one counts while it wants the stream.

    A consumer is known by its `schemas.keys.Wanted` token, and the budget ends with that, as when a link is lost: one
    that is still so is to be said again every few seconds.

    consumer, stream: those of the token.
    hz: the most frames a second of the consumer's own time that it has a use for; None for any number of them.
    wait_s: how long after this message the next of them is wanted, so that cameras take turns.
    """

    robot: Name
    camera: Name
    consumer: Name
    stream: Label
    hz: Annotated[float, msgspec.Meta(ge=LEAST_HZ)] | None = None
    wait_s: Annotated[float, msgspec.Meta(ge=0, le=MOST_WAIT_S)] = 0.0

    def __post_init__(self) -> None:
        """Hold the numbers to being some.

        Raises:
            SchemaError: a rate or a time is infinite, or not a number.
        """
        if not math.isfinite(self.wait_s) or not (self.hz is None or math.isfinite(self.hz)):
            raise SchemaError(f"a budget of {self.hz} Hz in {self.wait_s} s")
