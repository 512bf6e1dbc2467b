"""Order of names, rounding, times and CSV cells wherever the monitor shows or exports them. Pure."""

import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from typing import Any, Final, TypeVar

from schemas.keys import CameraKey
from schemas.printing import printable

T = TypeVar("T")

EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)

DIGITS: Final = 3
"""Digits after the decimal point: millimetres, milliseconds and thousandths, the precision of all data here."""

_FORMULA: Final = re.compile(r"(\A|[;\t\r\n]\s*)(?=[=+\-@\t\r\n])")
"""The places where spreadsheets take text for a formula: names of classes and workers may hold any characters."""


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


def moment(ns: int) -> datetime:
    """Return a UTC time with microseconds; out-of-range times become the last valid one."""
    try:
        return EPOCH + timedelta(microseconds=ns // 1_000)
    except OverflowError:
        return datetime.max.replace(tzinfo=UTC)


def epoch_ns(at: datetime) -> int:
    """Return nanoseconds since the epoch; a time without a zone is local."""
    return round(at.timestamp() * 1e6) * 1_000


def as_text(value: Any) -> Any:
    """Return a CSV cell that no spreadsheet evaluates: text that begins like a formula gets a leading `'`.

    Also behind what spreadsheets of other countries, or with other settings, take for the end of a cell.
    """
    return _FORMULA.sub(r"\1'", value) if isinstance(value, str) else value


MAX_SHOWN: Final = 5
"""Maximum number of problems that are listed."""


def problem_lines(problems: Mapping[str, Iterable[str]]) -> list[str]:
    """Return a line for each problem of each robot."""
    return [printable(f"{robot} {problem}") for robot in sorted(problems, key=natural) for problem in problems[robot]]


def limited(lines: Sequence[str], most: int = MAX_SHOWN) -> list[str]:
    """Return at most `most` lines, plus one that counts the rest."""
    rest = len(lines) - most
    return [*lines[:most], *([f"and {rest} more problem{'s' if rest > 1 else ''}"] if rest > 0 else [])]
