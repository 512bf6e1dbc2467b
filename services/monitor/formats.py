"""How names are ordered and figures are rounded wherever the monitor shows or exports them. Pure."""

import re
from collections.abc import Iterable
from functools import lru_cache
from typing import Final, TypeVar

from schemas.keys import CameraKey

T = TypeVar("T")

DIGITS: Final = 3
"""Behind the point: millimetres, milliseconds and thousandths, beyond which nothing here is known."""


def rounded(value: T) -> T:
    """Return a figure with no more than DIGITS behind its point; what is no float stays as it is."""
    return round(value, DIGITS) if isinstance(value, float) else value  # type: ignore[return-value]


@lru_cache(maxsize=50_000)
def natural(name: str) -> tuple[tuple[int, str], ...]:
    """Return what a name is sorted by."""
    return tuple((int(digits or -1), text.casefold()) for digits, text in re.findall(r"(\d{1,18})|(\D+)", name))


def natural_camera(key: CameraKey) -> tuple[tuple[tuple[int, str], ...], ...]:
    """Return what a camera is sorted by."""
    return natural(key.robot), natural(key.camera)


def cameras_in_order(keys: Iterable[CameraKey]) -> tuple[CameraKey, ...]:
    """Return cameras by robot and name; those of a fleet are the same for hours."""
    return _in_order(tuple(keys))


@lru_cache(maxsize=4)
def _in_order(keys: tuple[CameraKey, ...]) -> tuple[CameraKey, ...]:
    return tuple(sorted(keys, key=natural_camera))
