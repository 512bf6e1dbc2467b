"""Figures as files and the HTTP API give them. Pure."""

from typing import Final, TypeVar

T = TypeVar("T")

DIGITS: Final = 3
"""Behind the point: millimetres, milliseconds and thousandths, beyond which nothing here is known."""


def rounded(value: T) -> T:
    """Return a figure with no more than DIGITS behind its point; what is no float stays as it is."""
    return round(value, DIGITS) if isinstance(value, float) else value  # type: ignore[return-value]
