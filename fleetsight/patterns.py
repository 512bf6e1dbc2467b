"""Which robots and cameras are meant: names in which `*` stands for any number of characters. Pure."""

import re
from typing import Final

from fleetsight.arguments import check_text
from fleetsight.errors import SettingsError
from schemas.errors import SchemaError
from schemas.keys import CameraKey

PATTERN: Final = re.compile(r"[A-Za-z0-9_.\-*]{1,64}")


def chunk(what: str, pattern: str) -> str:
    """Return the chunk of a Zenoh key expression that a pattern is. what: whose name it is.

    Raises:
        SettingsError: it has characters that no name has.
    """
    check_text(f"{what} pattern", pattern)
    if not PATTERN.fullmatch(pattern):
        raise SettingsError(
            f"{what} pattern {pattern[:80]!r}: no such name can be; use 1 to 64 letters, digits, '_', '-', '.' and '*'"
        )
    return "*" if set(pattern) == {"*"} else re.sub(r"\*+", "$*", pattern)


def one_camera(robot: str, camera: str) -> CameraKey:
    """Return the key of one camera, by its whole names.

    Raises:
        SettingsError: a name that is not valid.
    """
    check_text("robot name", robot)
    check_text("camera name", camera)
    try:
        return CameraKey(robot, camera)
    except SchemaError as error:
        raise SettingsError(f"{robot[:80]}/{camera[:80]}: {error}") from error
