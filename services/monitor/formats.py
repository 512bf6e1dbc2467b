"""Order of names and rounding of figures wherever the monitor shows or exports them. Pure."""

import re
from collections.abc import Iterable
from functools import lru_cache
from typing import Final, TypeVar

from schemas.keys import CameraKey

T = TypeVar("T")

DIGITS: Final = 3
"""Digits after the decimal point: millimetres, milliseconds and thousandths, the precision of all data here."""


def rounded(value: T) -> T:
    """Return a float rounded to DIGITS digits after the point; other values unchanged."""
    return round(value, DIGITS) if isinstance(value, float) else value  # type: ignore[return-value]


@lru_cache(maxsize=50_000)
def natural(name: str) -> tuple[tuple[int, str], ...]:
    """Return the natural sort key of a name."""
    return tuple((int(digits or -1), text.casefold()) for digits, text in re.findall(r"(\d{1,18})|(\D+)", name))


def natural_camera(key: CameraKey) -> tuple[tuple[tuple[int, str], ...], ...]:
    """Return the natural sort key of a camera."""
    return natural(key.robot), natural(key.camera)


def cameras_in_order(keys: Iterable[CameraKey]) -> tuple[CameraKey, ...]:
    """Return cameras by robot and name; cached, as a fleet's cameras rarely change."""
    return _in_order(tuple(keys))


@lru_cache(maxsize=4)
def _in_order(keys: tuple[CameraKey, ...]) -> tuple[CameraKey, ...]:
    return tuple(sorted(keys, key=natural_camera))
