"""Graph resource names: what is legal, and what a name means from where it is used."""

from __future__ import annotations

import re

from gateway.ros1.errors import InvalidNameError

_NAME = re.compile(r"(?:[~/]\w|[A-Za-z])\w*(?:/\w+)*", re.ASCII)
_SLASHES = re.compile("/+")
_TYPE = re.compile(r"[A-Za-z]\w*/[A-Za-z]\w*", re.ASCII)
MAX_NAME_CHARACTERS = 1024


def validate(name: str) -> str:
    """Return the name.

    Raises:
        InvalidNameError: not a legal global, relative or private name.

    """
    if len(name) > MAX_NAME_CHARACTERS or not _NAME.fullmatch(name):
        raise InvalidNameError(f"not a ROS name: {name[:80]!r}")
    return name


def validate_global(name: str) -> str:
    """Return the name.

    Raises:
        InvalidNameError: not a legal name that starts with `/`.

    """
    if not name.startswith("/"):
        raise InvalidNameError(f"not a global ROS name: {name[:80]!r}")
    return validate(name)


def validate_type(name: str) -> str:
    """Return the message type's name, `package/Type`.

    Raises:
        InvalidNameError: anything else.

    """
    if len(name) > MAX_NAME_CHARACTERS or not _TYPE.fullmatch(name):
        raise InvalidNameError(f"not a ROS message type: {name[:80]!r}")
    return name


def namespace_of(name: str) -> str:
    """Return the namespace a global name is in, with a `/` at its end."""
    return validate_global(name).rpartition("/")[0] + "/"


def resolve(name: str, node: str) -> str:
    """Return the global name that `name` means within the node called `node`; doubled slashes count as one.

    Raises:
        InvalidNameError: the name or the node's name is not legal.

    """
    validate_global(node)
    name = validate(_SLASHES.sub("/", name).rstrip("/"))
    if name.startswith("~"):
        return f"{node}/{name[1:]}"
    return name if name.startswith("/") else namespace_of(node) + name
