"""Values that nobody expects where they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from random import Random

WORDS: Final = ("", "/", "~", "/a//b", "a" * 300, "\u00e4", "*", "r1", "/ours", "http://robot:1/", "../..", "%s", "\n")
NUMBERS: Final = (0, 1, -1, 2**31 - 1, -(2**31), 0.5, float("inf"), float("nan"), 1e300)
MAX_DEPTH: Final = 5


def something(rng: Random, depth: int = 0) -> Any:
    """Return a value of any type that JSON has, nested or not."""
    choice = rng.randrange(4 if depth >= MAX_DEPTH else 7)
    if choice == 0:
        return rng.choice(WORDS)
    if choice in (1, 2):
        return rng.choice(NUMBERS)
    if choice == 3:
        return rng.random() < 0.5
    inner = [something(rng, depth + 1) for _ in range(rng.choice((0, 1, 1, 2, 3)))]
    return inner if choice < 6 else {rng.choice(WORDS): value for value in inner}
