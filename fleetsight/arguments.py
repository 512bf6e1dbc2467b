"""Arguments that are not valid, refused at once and by name."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import msgspec

from bus import Latest
from bus import Queue as AnyQueue
from fleetsight.errors import SettingsError
from schemas import keys
from schemas.budget import LEAST_HZ
from schemas.errors import SchemaError

SHOWN: Final = 80
"""Characters of a value that an error shows."""


@dataclass(frozen=True, slots=True)
class Queue(AnyQueue):
    """Keep the `depth` newest messages, in order of arrival.

    Raises:
        SettingsError: the depth is no whole number above 0.

    >>> fleetsight.QUEUE(100).depth
    100
    """

    def __post_init__(self) -> None:
        depth: object = self.depth
        if not isinstance(depth, int) or depth < 1:
            raise SettingsError(f"queue depth {shown(self.depth)}: use a whole number above 0")


QUEUE: Final = Queue


def shown(value: object) -> str:
    """Return a value as an error shows it."""
    return repr(value)[:SHOWN]


def check_text(what: str, value: object) -> None:
    """Raise SettingsError unless a value is text. what: it is."""
    if not isinstance(value, str):
        raise SettingsError(f"{what} {shown(value)}: not text; pass a str")


def check_name(what: str, name: str) -> None:
    """Raise SettingsError unless `name` can be that of a robot, a camera or a worker; `what` says which."""
    check_text(f"{what} name", name)
    try:
        keys.check_name(what, name)
    except SchemaError as error:
        raise SettingsError(str(error)) from error


def check_keep(keep: object) -> None:
    """Raise SettingsError unless this says what is kept of a stream."""
    if not isinstance(keep, Latest | AnyQueue):
        raise SettingsError(f"keep {shown(keep)}: a stream cannot keep that; use LATEST or QUEUE(100) of fleetsight")


def number(what: str, value: float) -> float:
    """Return a number as a float.

    Raises:
        SettingsError: it is none.
    """
    try:
        given = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise SettingsError(f"{what} {shown(value)}: {error}; give a float") from error
    if math.isnan(given):
        raise SettingsError(f"{what} nan: not a number; pass one")
    return given


def time_s(what: str, value: float, *, most_s: float = math.inf) -> float:
    """Return a time in seconds.

    Raises:
        SettingsError: it is none, not above 0, or above `most_s`.
    """
    given = number(what, value)
    if not 0 < given <= most_s:
        most = "" if most_s == math.inf else f", up to {most_s:g} s"
        raise SettingsError(f"{what} {given:g}: out of its bounds; use more than 0 s{most}")
    return given


def rate_hz(what: str, value: float | None) -> float | None:
    """Return a rate that a camera can be asked for, in images a second; None for all of them.

    Raises:
        SettingsError: it is no such rate.
    """
    if value is None:
        return None
    given = number(what, value)
    if not LEAST_HZ <= given < math.inf:
        raise SettingsError(f"{what} {given:g}: out of its bounds; use {LEAST_HZ:g} Hz or more, or None for all images")
    return given


def names(what: str, given: Sequence[str]) -> list[str]:
    """Return a list of texts.

    Raises:
        SettingsError: it is one text, or nothing that has texts.
    """
    if isinstance(given, str):
        raise SettingsError(f"{what} {shown(given)}: it is one text; give a list, such as [{shown(given)}]")
    try:
        return list(given)
    except TypeError as error:
        raise SettingsError(f"{what} {shown(given)}: {error}; give a list of str") from error


def check_fields(schema: type[msgspec.Struct], **given: object) -> None:
    """Hold what is to be fields of a message to its schema, as the message's readers do.

    Raises:
        SettingsError: nobody could read a field.
    """
    kinds = {each.name: each.type for each in msgspec.structs.fields(schema)}
    for name, value in given.items():
        try:
            msgspec.msgpack.decode(msgspec.msgpack.encode(value), type=kinds[name])
        except (msgspec.MsgspecError, TypeError, ValueError, OverflowError) as error:
            raise SettingsError(f"{name} {shown(value)}: {error}; give another, which others can read") from error
