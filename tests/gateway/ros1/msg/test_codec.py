from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest

from gateway.ros1.errors import MessageError
from gateway.ros1.msg.codec import NOT_SUCH_A_MESSAGE, Codec, Duration, Time, compiled
from gateway.ros1.msg.definition import parse

TEXTS = {
    "a/Inner": "string name\nuint16 number",
    "a/All": "bool yes\nInner[] many\nInner[2] two\nfloat32[] reals\nuint8[3] bytes\nbool[] flags\n"
    "time at\nduration lasts\nstring[] words\nbyte[] signed",
    "a/Bytes": "uint8[] data",
    "a/Reals": "float64[2] data",
    "a/Nothing": "",
    "a/NothingInside": "Nothing one\nNothing[0] none",
    "a/AnyNumberOfNothing": "NothingInside[] all",
}
DEFINITIONS = {name: parse(name, text) for name, text in TEXTS.items()}
REFUSED = (MessageError, *NOT_SUCH_A_MESSAGE)


def codec(name: str) -> Codec:
    return compiled(DEFINITIONS, name)


def inner(name: str, number: int) -> Any:
    return codec("a/Inner").make(name, number)


def everything(**changes: Any) -> Any:
    fields = {
        "yes": True,
        "many": [inner("x", 1)],
        "two": [inner("", 2), inner("yz", 65535)],
        "reals": np.array([0.5, -1], "<f4"),
        "bytes": b"\x01\x02\x03",
        "flags": [True, False],
        "at": Time(2**32 - 1, 5),
        "lasts": Duration(-1, -(2**31)),
        "words": ["ä", ""],
        "signed": [-128, 127],
    }
    return codec("a/All").make(**{**fields, **changes})


WHOLE = b"".join(
    [
        b"\x01",
        struct.pack("<II", 1, 1) + b"x" + struct.pack("<H", 1),
        struct.pack("<IH", 0, 2) + struct.pack("<I", 2) + b"yz" + struct.pack("<H", 65535),
        struct.pack("<Iff", 2, 0.5, -1),
        b"\x01\x02\x03",
        b"\x02\x00\x00\x00\x01\x00",
        struct.pack("<IIii", 2**32 - 1, 5, -1, -(2**31)),
        struct.pack("<II", 2, 2) + "ä".encode() + struct.pack("<I", 0),
        struct.pack("<Ibb", 2, -128, 127),
    ]
)


def test_everything_is_written_as_it_should_be() -> None:
    assert codec("a/All").write(everything()) == WHOLE


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_everything_is_read_as_it_was(kind: type[bytes]) -> None:
    found = codec("a/All").read(kind(WHOLE))
    assert (found.yes, found.many, found.two) == (True, [inner("x", 1)], [inner("", 2), inner("yz", 65535)])
    assert (found.reals.tolist(), found.bytes.tolist(), found.flags.tolist()) == ([0.5, -1], [1, 2, 3], [True, False])
    assert (found.at, found.lasts, found.words) == (Time(2**32 - 1, 5), Duration(-1, -(2**31)), ["ä", ""])
    assert found.signed.tolist() == [-128, 127]
    assert codec("a/All").write(found) == WHOLE


@pytest.mark.parametrize("size", range(len(WHOLE)))
def test_cut_off_anywhere(size: int) -> None:
    with pytest.raises(REFUSED):
        codec("a/All").read(WHOLE[:size])


def test_something_behind_the_end() -> None:
    with pytest.raises(MessageError, match=f"end at {len(WHOLE)}"):
        codec("a/All").read(WHOLE + b"\x00")


@pytest.mark.parametrize("name", ["a/All", "a/Bytes", "a/Inner"])
def test_a_length_that_lies(name: str) -> None:
    with pytest.raises(REFUSED):
        codec(name).read(b"\xff" * 8)


def test_truths_of_any_byte_are_true() -> None:
    flags = codec("a/All").read(WHOLE.replace(b"\x02\x00\x00\x00\x01\x00", b"\x02\x00\x00\x00\xff\x00")).flags
    assert flags.tolist() == [True, False]


def test_arrays_of_numbers_are_views() -> None:
    data = bytearray(b"\x03\x00\x00\x00abc")
    found = codec("a/Bytes").read(data).data
    data[4:] = b"xyz"
    assert found.tobytes() == b"xyz"


@pytest.mark.parametrize(
    "value", [b"abc", bytearray(b"abc"), memoryview(b"abc"), [97, 98, 99], np.frombuffer(b"abc", "u1")]
)
def test_bytes_are_written_from(value: Any) -> None:
    message = codec("a/Bytes").make(value)
    assert codec("a/Bytes").write(message) == b"\x03\x00\x00\x00abc"


def test_arrays_with_gaps_are_written() -> None:
    gaps = np.arange(6, dtype=np.float64)[::3]
    assert codec("a/Reals").write(codec("a/Reals").make(gaps)) == struct.pack("<dd", 0, 3)


@pytest.mark.parametrize(
    "changes",
    [
        {"two": [inner("", 1)]},
        {"bytes": b"\x01\x02"},
        {"bytes": np.zeros(3, "<u2")},
        {"reals": np.zeros(3)},
        {"reals": ["x"]},
        {"words": [b"bytes"]},
        {"words": None},
        {"words": ["\ud800"]},
        {"many": [5]},
        {"two": [inner("", 65536), inner("", 1)]},
        {"at": Time(-1, 0)},
        {"at": 5},
        {"lasts": Duration(2**31, 0)},
        {"signed": [128]},
    ],
    ids=str,
)
def test_what_does_not_fit(changes: dict[str, Any]) -> None:
    with pytest.raises(REFUSED):
        codec("a/All").write(everything(**changes))


def test_type_without_fields() -> None:
    assert codec("a/Nothing").write(codec("a/Nothing").make()) == b""
    assert codec("a/Nothing").read(b"") == codec("a/Nothing").make()
    with pytest.raises(MessageError):
        codec("a/Nothing").read(b"x")


def test_classes_are_the_same_alone_and_inside() -> None:
    assert type(codec("a/All").read(WHOLE).many[0]) is codec("a/Inner").make


def test_any_number_of_what_takes_no_bytes_would_never_end() -> None:
    with pytest.raises(MessageError, match="takes no bytes"):
        codec("a/AnyNumberOfNothing")
    with pytest.raises(KeyError):
        codec("a/Unknown")
