import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.compression import Picture, picture_of
from schemas.errors import SchemaError
from tests.schemas.pictures import file_of

GREY = np.zeros((4, 6), np.uint8)
DEEP = np.zeros((4, 6), np.uint16)
COLOR = np.zeros((4, 6, 3), np.uint8)
ALPHA = np.zeros((4, 6, 4), np.uint8)
FILES = {
    ("jpeg", "mono8"): file_of(GREY, ".jpg"),
    ("jpeg", "rgb8"): file_of(COLOR, ".jpg"),
    ("png", "mono8"): file_of(GREY, ".png"),
    ("png", "mono16"): file_of(DEEP, ".png"),
    ("png", "rgb8"): file_of(COLOR, ".png"),
    ("png", "rgba8"): file_of(ALPHA, ".png"),
}


@pytest.mark.parametrize(("kind", "encoding"), FILES)
def test_a_file_says_what_it_holds(kind: str, encoding: str) -> None:
    assert picture_of(memoryview(FILES[kind, encoding])) == Picture(kind, 4, 6, encoding)


def test_fill_bytes_may_stand_before_a_jpegs_segments() -> None:
    data = FILES["jpeg", "rgb8"]
    filled = data[:2] + b"\xff" * 9 + data[2:]
    assert picture_of(memoryview(filled)) == Picture("jpeg", 4, 6, "rgb8")


@pytest.mark.parametrize(("kind", "encoding"), FILES)
def test_a_file_cut_off_before_its_size_is_refused(kind: str, encoding: str) -> None:
    data = FILES[kind, encoding]
    known = next(size for size in range(len(data) + 1) if said(data[:size]))
    assert not any(said(data[:size]) for size in range(known))
    assert all(said(data[:size]) == Picture(kind, 4, 6, encoding) for size in range(known, len(data)))


def said(data: bytes) -> Picture | None:
    try:
        return picture_of(memoryview(data))
    except SchemaError:
        return None


@given(
    st.binary(max_size=100),
    st.sampled_from([b"", b"\xff\xd8", b"\xff\xd8\xff\xe0\x00\x02", FILES["png", "mono8"][:16]]),
)
def test_whatever_begins_like_a_file(rest: bytes, start: bytes) -> None:
    said(start + rest)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "neither a JPEG nor a PNG file"),
        (b"GIF89a....", "neither a JPEG nor a PNG file: it begins with b'GIF89a..'"),
        (FILES["png", "mono8"][:16] + struct.pack(">IIBB", 6, 4, 16, 2), "16 bits and colour type 2"),
        (b"\xff\xd8\xff\xe0\x00\x01", "a JPEG file with 0xff 0xe0 at byte 2"),
        (b"\xff\xd8\x00\xe0\x00\x04", "a JPEG file with 0x0 0xe0 at byte 2"),
        (b"\xff\xd8\xff\xc0\x00\x11\x08\x00\x04\x00\x06\x04", "a JPEG file with 4 channels"),
    ],
)
def test_what_is_refused_is_named(data: bytes, reason: str) -> None:
    with pytest.raises(SchemaError, match=reason):
        picture_of(memoryview(data))
