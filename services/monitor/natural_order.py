"""Names in the order in which people count: r2 comes before r10. Pure."""

import re
from collections.abc import Iterable
from functools import lru_cache

from schemas.keys import CameraKey


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
