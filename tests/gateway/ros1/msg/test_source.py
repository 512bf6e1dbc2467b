from __future__ import annotations

from gateway.ros1.msg.definition import parse
from gateway.ros1.msg.source import Reading, Writing

DEFINITIONS = {
    "a/Point": parse("a/Point", "float64 x\nfloat64 y"),
    "a/Path": parse("a/Path", "uint8 kind\nPoint first\nPoint last\nuint32 number\nstring name"),
}


def test_fixed_fields_are_read_and_written_at_once_whatever_they_are_nested_in() -> None:
    reading, writing = Reading(DEFINITIONS), Writing(DEFINITIONS)
    read, write = reading.function("a/Path"), writing.function("a/Path")
    assert reading.formats == writing.formats == ["<BddddII"]
    assert (read.count("unpack_from"), write.count("pack(")) == (1, 1)
