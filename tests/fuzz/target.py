"""What is fuzzed: a way to feed bytes to a parser, good inputs to begin with, and the errors it documents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from random import Random


class LeftOutError(Exception):
    """A stream counted a message as one that it cannot carry."""


@dataclass(frozen=True, slots=True)
class Target:
    """One parser. `feed` may cut its input as the generator says.

    made: makes inputs that are well-formed and still not what is expected; they are spoilt further, or not.
    """

    name: str
    seeds: Sequence[bytes]
    feed: Callable[[bytes, Random], object]
    documented: tuple[type[Exception], ...]
    made: Callable[[Random], bytes] | None = None
