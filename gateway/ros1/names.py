"""Graph resource names: validation, resolution and remapping. Pure."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gateway.ros1.errors import InvalidNameError

if TYPE_CHECKING:
    from collections.abc import Mapping

_NAME = re.compile(r"(?:[~/]\w|[A-Za-z])\w*(?:/\w+)*", re.ASCII)
_SLASHES = re.compile("/+")
_TYPE = re.compile(r"[A-Za-z]\w*/[A-Za-z]\w*", re.ASCII)
MAX_NAME_CHARACTERS = 1024


def validate(name: str) -> str:
    """Return the name if it is a legal one.

    Raises:
        InvalidNameError: not a legal global, relative or private name.

    """
    if len(name) > MAX_NAME_CHARACTERS or not _NAME.fullmatch(name):
        raise InvalidNameError(f"not a ROS name: {name[:80]!r}")
    return name


def validate_global(name: str) -> str:
    """Return the name if it is a legal one.

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
    """Return the global name of `name` in the node `node`; doubled slashes count as one.

    Raises:
        InvalidNameError: the name or the node's name is not legal.

    """
    validate_global(node)
    name = validate(_SLASHES.sub("/", name).rstrip("/"))
    if name.startswith("~"):
        return f"{node}/{name[1:]}"
    return name if name.startswith("/") else namespace_of(node) + name


@dataclass(frozen=True, slots=True)
class Names:
    """Name resolution of a node with remappings, which replace whole names, as in roscpp and rospy.

    node: its global name. remaps: from name to name, each as it is written in that node.

    Raises:
        InvalidNameError: a name is not legal.

    """

    node: str
    remaps: Mapping[str, str] = field(default_factory=dict)
    _resolved: dict[str, str] = field(init=False, default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        for name, other in self.remaps.items():
            self._resolved[resolve(name, self.node)] = resolve(other, self.node)

    def resolve(self, name: str) -> str:
        """Return the global name of `name` after remapping.

        Raises:
            InvalidNameError: the name is not legal.

        """
        meant = resolve(name, self.node)
        return self._resolved.get(meant, meant)
