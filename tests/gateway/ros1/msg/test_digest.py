from __future__ import annotations

import hashlib

import pytest

from gateway.ros1.msg.definition import md5sum, parse, whole_text

TEXTS = {
    "std_msgs/Header": "uint32 seq\ntime stamp\nstring frame_id",
    "a/Inner": "Header header\nuint8[2] pair # of something",
    "a/Outer": "Inner[] inner\nuint8 LATER=7\nInner other\nHeader header",
}
DEFINITIONS = {name: parse(name, text) for name, text in TEXTS.items()}
HEADER_MD5 = "2176decaecbce78abc3b96ef049fabed"


def md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()


def test_md5sum_is_of_what_counts() -> None:
    inner = md5(f"{HEADER_MD5} header\nuint8[2] pair")
    assert md5sum(DEFINITIONS, "std_msgs/Header") == HEADER_MD5
    assert md5sum(DEFINITIONS, "a/Inner") == inner
    assert md5sum(DEFINITIONS, "a/Outer") == md5(f"uint8 LATER=7\n{inner} inner\n{inner} other\n{HEADER_MD5} header")


def test_whole_text_has_every_dependency_once() -> None:
    bar = "=" * 80
    assert whole_text(DEFINITIONS, "a/Outer") == "\n".join(
        [
            TEXTS["a/Outer"],
            bar,
            "MSG: a/Inner",
            TEXTS["a/Inner"],
            bar,
            "MSG: std_msgs/Header",
            TEXTS["std_msgs/Header"],
        ]
    )


def test_type_without_a_definition() -> None:
    with pytest.raises(KeyError):
        md5sum({"a/Inner": DEFINITIONS["a/Inner"]}, "a/Inner")
