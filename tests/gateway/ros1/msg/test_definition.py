from __future__ import annotations

import pytest

from gateway.ros1.errors import MessageError
from gateway.ros1.msg.definition import Constant, Field, parse

WHOLE = """\
# What it is
uint8 A=5   # a first value
string  NAME =  two words # and a sign
  float32 HALF = 0.5

Header header          # the usual one
Thing  one
other_msgs/Thing[] many
string[3]\tnames
time[] moments
"""


def test_fields_and_constants() -> None:
    found = parse("some_msgs/Whole", WHOLE)
    assert found.constants == (
        Constant("A", "uint8", "5"),
        Constant("NAME", "string", "two words # and a sign"),
        Constant("HALF", "float32", "0.5"),
    )
    assert found.fields == (
        Field("header", "std_msgs/Header"),
        Field("one", "some_msgs/Thing"),
        Field("many", "other_msgs/Thing", is_array=True),
        Field("names", "string", is_array=True, length=3),
        Field("moments", "time", is_array=True),
    )
    assert [field.is_message for field in found.fields] == [True, True, True, False, False]


@pytest.mark.parametrize("text", ["", "\n\n", "# only a word", "   \t"])
def test_nothing_at_all(text: str) -> None:
    assert parse("some_msgs/Empty", text).fields == ()


@pytest.mark.parametrize(
    "line",
    [
        "uint8",
        "uint8 a b",
        "uint8 1a",
        "uint8[-1] a",
        "uint8[2][2] a",
        "a/b/c d",
        "/Thing a",
        "uint8 class",
        "uint8 \u00e4",
        "uint8 a\u00e4",
        "uint8 a; import os",
        "Thing A=1",
        "time A=1",
        "=1",
        "uint8 =1",
        "---",
    ],
)
def test_what_is_neither_field_nor_constant(line: str) -> None:
    with pytest.raises(MessageError, match="some_msgs/Bad"):
        parse("some_msgs/Bad", line)


def test_two_fields_of_one_name() -> None:
    with pytest.raises(MessageError, match="two fields"):
        parse("some_msgs/Twice", "uint8 a\nint8 a")
