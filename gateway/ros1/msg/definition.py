"""Parser of ROS 1's .msg language into fields and constants."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from keyword import iskeyword
from typing import TYPE_CHECKING, Final, TypeAlias

from gateway.ros1.errors import MessageError

if TYPE_CHECKING:
    from collections.abc import Iterator


STRING: Final = "string"
MOMENTS: Final = {"time": "II", "duration": "ii"}
NUMBERS: Final = {
    "bool": "?",
    "byte": "b",
    "char": "B",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
"""The struct code of each numeric type; contrary to their names, `byte` is signed and `char` unsigned."""

_HEADER: Final = "std_msgs/Header"
_CONSTANT: Final = re.compile(r"(?P<type>\w+)\s+(?P<name>[A-Za-z]\w*)\s*=\s*(?P<value>.*)", re.ASCII)
_FIELD: Final = re.compile(
    r"(?P<type>[A-Za-z]\w*(/[A-Za-z]\w*)?)(?P<array>\[(?P<length>\d*)\])?\s+(?P<name>[A-Za-z]\w*)", re.ASCII
)


@dataclass(frozen=True, slots=True)
class Field:
    """One field: of a built-in type, or of a message type given with its package.

    length: of a fixed array; None for one of any length and for no array.
    """

    name: str
    type: str
    is_array: bool = False
    length: int | None = None

    @property
    def is_message(self) -> bool:
        return "/" in self.type


@dataclass(frozen=True, slots=True)
class Constant:
    """A named value, as it is written."""

    name: str
    type: str
    value: str


@dataclass(frozen=True, slots=True)
class Definition:
    """One message type without its dependencies."""

    name: str
    text: str
    fields: tuple[Field, ...]
    constants: tuple[Constant, ...]


Definitions: TypeAlias = Mapping[str, Definition]


def parse(name: str, text: str) -> Definition:
    """Read the definition of the message type `package/Name`.

    Raises:
        MessageError: a line is neither field nor constant, or two fields have one name.

    """
    package = name.partition("/")[0]
    fields: list[Field] = []
    constants: list[Constant] = []
    for line in text.splitlines():
        code = line.partition("#")[0].strip()
        if "=" in code:
            constants.append(_constant(name, line.strip()))
        elif code:
            fields.append(_field(name, package, code))
    if len({field.name for field in fields}) < len(fields):
        raise MessageError(f"{name} has two fields of one name")
    return Definition(name, text, tuple(fields), tuple(constants))


def _constant(name: str, line: str) -> Constant:
    found = _CONSTANT.fullmatch(line)
    if found is None or found["type"] not in {*NUMBERS, STRING}:
        raise MessageError(f"{name}: no constant: {line[:80]!r}")
    # A string constant extends to the end of the line, `#` included.
    value = found["value"] if found["type"] == STRING else found["value"].partition("#")[0]
    return Constant(found["name"], found["type"], value.strip())


def _field(name: str, package: str, code: str) -> Field:
    found = _FIELD.fullmatch(code)
    if found is None or iskeyword(found["name"]):
        raise MessageError(f"{name}: no field: {code[:80]!r}")
    length = int(found["length"]) if found["length"] else None
    return Field(found["name"], _qualified(found["type"], package), bool(found["array"]), length)


def _qualified(name: str, package: str) -> str:
    if name in NUMBERS or name in MOMENTS or name == STRING or "/" in name:
        return name
    return _HEADER if name == "Header" else f"{package}/{name}"


_SEPARATOR = "=" * 80


def md5sum(definitions: Definitions, *names: str) -> str:
    """Return the md5sum of a message type, or that of a service, given its request and its response.

    Raises:
        KeyError: a type, or one that it needs, has no definition.

    """
    text = "".join(_essence(definitions, name) for name in names)
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()


def _essence(definitions: Definitions, name: str) -> str:
    """Return the text that md5sums are made of: constants first, nested messages by their md5sum."""
    definition = definitions[name]
    constants = [f"{constant.type} {constant.name}={constant.value}" for constant in definition.constants]
    return "\n".join(constants + [_digest_field(definitions, field) for field in definition.fields])


def _digest_field(definitions: Definitions, field: Field) -> str:
    if field.is_message:
        return f"{md5sum(definitions, field.type)} {field.name}"
    array = f"[{'' if field.length is None else field.length}]" if field.is_array else ""
    return f"{field.type}{array} {field.name}"


def whole_text(definitions: Definitions, name: str) -> str:
    """Return a type's definition followed by those of its dependencies, each once.

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
