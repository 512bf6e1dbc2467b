"""What two peers compare of a message type, and what a publisher sends of it."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gateway.ros1.msg.definition import Definition, Definitions, Field

_SEPARATOR = "=" * 80


def md5sum(definitions: Definitions, *names: str) -> str:
    """Return the md5sum of a message type, or that of a service, given its request and its response.

    Raises:
        KeyError: a type, or one that it needs, has no definition.

    """
    text = "".join(_essence(definitions, name) for name in names)
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()


def _essence(definitions: Definitions, name: str) -> str:
    """Return what counts: constants first, messages by their own md5sum."""
    definition = definitions[name]
    constants = [f"{constant.type} {constant.name}={constant.value}" for constant in definition.constants]
    return "\n".join(constants + [_field(definitions, field) for field in definition.fields])


def _field(definitions: Definitions, field: Field) -> str:
    if field.is_message:
        return f"{md5sum(definitions, field.type)} {field.name}"
    array = f"[{'' if field.length is None else field.length}]" if field.is_array else ""
    return f"{field.type}{array} {field.name}"


def whole_text(definitions: Definitions, name: str) -> str:
    """Return a type's definition followed by those of all types that it needs, each once.

    Raises:
        KeyError: one of them has no definition.

    """
    needed = dict.fromkeys(_needed(definitions, definitions[name]))
    parts = [f"{_SEPARATOR}\nMSG: {each}\n{definitions[each].text}" for each in needed]
    return "\n".join([definitions[name].text, *parts])


def _needed(definitions: Definitions, definition: Definition) -> Iterator[str]:
    for field in definition.fields:
        if field.is_message:
            yield field.type
            yield from _needed(definitions, definitions[field.type])
