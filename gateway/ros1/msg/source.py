"""Generates Python source to read and write a message type: fields are unrolled, fixed-size ones grouped.

Both functions work with what `codec` puts into their namespace. A read past the end always raises: a text that is cut
off by a slice leaves the position outside, where nothing more can be read, and the whole must end where the bytes do.
Bytes of a text that are not UTF-8 are read as U+FFFD, as genpy reads them: one name costs no other part of its message.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

from gateway.ros1.errors import MessageError
from gateway.ros1.msg.definition import MOMENTS, NUMBERS, STRING

if TYPE_CHECKING:
    from gateway.ros1.msg.definition import Definitions, Field

_INDENT: Final = "    "


class _Source:
    """Lines of one function; numeric fields are grouped until a field of variable size follows."""

    def __init__(self, definitions: Definitions) -> None:
        self.lines: list[str] = []
        self.formats: list[str] = []
        self._definitions = definitions
        self._depth = 1
        self._names = 0
        self._waiting: list[tuple[str, str]] = []

    def _fields(self, name: str) -> tuple[Field, ...]:
        return self._definitions[name].fields

    def _add(self, line: str) -> None:
        self.lines.append(_INDENT * self._depth + line)

    def _name(self) -> str:
        self._names += 1
        return f"v{self._names}"

    def _wait(self, code: str, name: str) -> None:
        self._waiting.append((code, name))

    def _waited(self) -> tuple[str, str, int]:
        """Return the grouped fields: the struct's number, the names with commas, and the size in bytes."""
        self.formats.append("<" + "".join(code for code, _ in self._waiting))
        names = "".join(f"{name}, " for _, name in self._waiting)
        self._waiting = []
        return f"s{len(self.formats) - 1}", names, struct.calcsize(self.formats[-1])

    def _check_items(self, field: Field) -> None:
        if self._is_empty(field.type):
            raise MessageError(f"any number of {field.type} takes no bytes")

    def _is_empty(self, kind: str) -> bool:
        return "/" in kind and all(self._is_empty(field.type) for field in self._fields(kind) if field.length != 0)


class Reading(_Source):
    """`read(data) -> message`."""

    def function(self, name: str) -> str:
        """Return the source of the function that reads a message type."""
        message = self._message(name)
        self._flush()
        body = "\n".join(self.lines)
        return (
            f"def read(data):\n    at = 0\n{body}\n"
            f"    if at != len(data): raise MessageError(f'they end at {{at}}')\n    return {message}\n"
        )

    def _flush(self) -> None:
        if self._waiting:
            reader, names, size = self._waited()
            self._add(f"{names}= {reader}.unpack_from(data, at)")
            self._add(f"at += {size}")

    def _message(self, name: str) -> str:
        fields = [self._array(field) if field.is_array else self._single(field.type) for field in self._fields(name)]
        return f"make[{name!r}]({', '.join(fields)})"

    def _single(self, kind: str) -> str:
        if kind in NUMBERS:
            return self._number(NUMBERS[kind])
        if kind in MOMENTS:
            return f"{kind}({', '.join(self._number(code) for code in MOMENTS[kind])})"
        return self._text() if kind == STRING else self._message(kind)

    def _number(self, code: str) -> str:
        name = self._name()
        self._wait(code, name)
        return name

    def _text(self) -> str:
        length, text = self._number("I"), self._name()
        self._flush()
        self._add(f"{text} = str(data[at:at + {length}], 'utf-8', 'replace')")
        self._add(f"at += {length}")
        return text

    def _array(self, field: Field) -> str:
        count = self._number("I") if field.length is None else str(field.length)
        self._flush()
        items = self._name()
        if field.type in NUMBERS:
            code = NUMBERS[field.type]
            as_truth = " != 0" if code == "?" else ""
            self._add(f"{items} = frombuffer(data, '<{'B' if as_truth else code}', {count}, at){as_truth}")
            self._add(f"at += {count} * {struct.calcsize('<' + code)}")
            return items
        self._check_items(field)
        self._add(f"{items} = []")
        self._add(f"for _ in range({count}):")
        self._depth += 1
        item = self._single(field.type)
        self._flush()
        self._add(f"{items}.append({item})")
        self._depth -= 1
        return items


class Writing(_Source):
    """`write(message) -> bytes`."""

    def function(self, name: str) -> str:
        """Return the source of the function that writes a message type."""
        self._message(name, "message")
        self._flush()
        body = "\n".join(self.lines)
        return f"def write(message):\n    parts = []\n    add = parts.append\n{body}\n    return b''.join(parts)\n"

    def _flush(self) -> None:
        if self._waiting:
            writer, names, _ = self._waited()
            self._add(f"add({writer}.pack({names}))")

    def _message(self, name: str, source: str) -> None:
        for field in self._fields(name):
            if field.is_array:
                self._array(field, f"{source}.{field.name}")
            else:
                self._single(field.type, f"{source}.{field.name}")

    def _single(self, kind: str, source: str) -> None:
        if kind in NUMBERS:
            self._wait(NUMBERS[kind], source)
            return
        name = self._name()
        self._add(f"{name} = {source}" + (".encode()" if kind == STRING else ""))
        if kind == STRING:
            self._sized(name, f"len({name})")
        elif kind in MOMENTS:
            for code, part in zip(MOMENTS[kind], ("sec", "nanosec"), strict=True):
                self._wait(code, f"{name}.{part}")
        else:
            self._message(kind, name)

    def _sized(self, name: str, length: str) -> None:
        self._wait("I", length)
        self._flush()
        self._add(f"add({name})")

    def _array(self, field: Field, source: str) -> None:
        items = self._name()
        if field.type in NUMBERS:
            code = NUMBERS[field.type]
            self._add(f"{items} = packed({source}, '<{code}', {field.length})")
            size = struct.calcsize("<" + code)
            if field.length is None:
                self._wait("I", f"{items}.nbytes // {size}")
            self._flush()
            self._add(f"add({items})")
            return
        self._check_items(field)
        self._add(f"{items} = counted({source}, {field.length})")
        if field.length is None:
            self._wait("I", f"len({items})")
        self._flush()
        item = self._name()
        self._add(f"for {item} in {items}:")
        self._depth += 1
        self._single(field.type, item)
        self._flush()
        self._depth -= 1
