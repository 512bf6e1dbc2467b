import struct

import cv2
import numpy as np
import pytest
from backports import zstd
from hypothesis import given
from hypothesis import strategies as st

from schemas.compression import MAX_DECODED_BYTES, MAX_MARKERS, MAX_SCANS, MAX_SEGMENTS, Picture, check_zstd, picture_of
from schemas.errors import SchemaError
from tests.schemas.pictures import SCAN, file_of, resized

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


@pytest.mark.parametrize("segment", [b"\xff", b"\xff\xfe\x00\x02"], ids=["fill bytes", "empty comments"])
def test_a_jpeg_is_not_searched_for_its_size_for_ever(segment: bytes) -> None:
    data = FILES["jpeg", "rgb8"]
    own = next(
        number for number in range(MAX_SEGMENTS) if said(data[:2] + segment * (MAX_SEGMENTS - number) + data[2:])
    )
    assert 1 < own < 10
    with pytest.raises(SchemaError, match=f"says no size in its first {MAX_SEGMENTS} segments"):
        picture_of(memoryview(data[:2] + segment * (MAX_SEGMENTS - own + 1) + data[2:]))


@pytest.mark.parametrize("marker", [0x00, 0x01, 0xD0, 0xD7, 0xD8, 0xD9])
def test_a_jpeg_does_not_show_decoders_another_size(marker: int) -> None:
    large = file_of(np.zeros((32, 48), np.uint8), ".jpg")[2:]
    shown_to_us_alone = FILES["jpeg", "mono8"][2:]
    two_faced = b"\xff\xd8\xff" + bytes([marker]) + b"\xff\xff" + large.ljust(0xFFFD, b"\0") + shown_to_us_alone
    with pytest.raises(SchemaError, match=f"a JPEG file with 0xff {marker:#x} at byte 2"):
        picture_of(memoryview(two_faced))


def jpeg(height: int, width: int, channels: int, passes: int, *, first: bytes = b"") -> bytes:
    """Return a progressive file of scans over one component each. first: segments before its size."""
    scan = SCAN + b"\x00\x08\x01\x01\x00\x01\x05\x00"
    frame = b"\xff\xc2\x00\x11\x08" + struct.pack(">HHB", height, width, channels) + bytes(9)
    return b"\xff\xd8" + first + frame + scan * passes + b"\xff\xd9"


@pytest.mark.parametrize(
    ("height", "width", "channels", "most"),
    [
        (480, 640, 3, 300),
        (4, 6, 1, 100),
        (2160, 3840, 3, 161),
        (6608, 6608, 3, 30),
        (8192, 16384, 1, 10),
        (65535, 65535, 3, 3),
    ],
)
def test_the_scans_of_a_large_jpeg_are_fewer_than_those_of_a_small_one(
    height: int, width: int, channels: int, most: int
) -> None:
    assert said(jpeg(height, width, channels, most)) is not None
    with pytest.raises(SchemaError, match=r"scans go over \d+ component-pixels, at most \d+ are decoded"):
        picture_of(memoryview(jpeg(height, width, channels, most + 1)))


def test_a_jpeg_of_many_scans_says_how_many_pixels_they_go_over() -> None:
    reason = f"scans go over {301 * 64} component-pixels, at most {MAX_SCANS * 3 * 64} are decoded"
    with pytest.raises(SchemaError, match=reason):
        picture_of(memoryview(jpeg(8, 8, 3, 301)))


def test_a_jpegs_thumbnail_and_what_is_behind_it_are_no_scans_of_it() -> None:
    thumbnail = jpeg(120, 160, 3, 400)
    about = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 2) + thumbnail
    assert said(jpeg(480, 640, 3, 300, first=about) + thumbnail) == Picture("jpeg", 480, 640, "rgb8")


def test_a_jpegs_markers_are_not_read_for_ever() -> None:
    with pytest.raises(SchemaError, match=f"more than {MAX_MARKERS} markers"):
        picture_of(memoryview(jpeg(0, 0, 1, MAX_MARKERS)))


def test_a_large_progressive_jpeg_is_taken() -> None:
    made, file = cv2.imencode(".jpg", COLOR, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])
    assert made
    assert said(resized(file.tobytes(), 6_600, 6_600)) == Picture("jpeg", 6_600, 6_600, "rgb8")


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


@pytest.mark.parametrize("size", [0, 1, 255, 256, 257, 65_535, 65_536, 65_791, 65_792, 1_000_000])
@pytest.mark.parametrize("level", [1, 19])
def test_zstd_data_says_how_much_it_holds(size: int, level: int) -> None:
    for content in (bytes(size), np.random.default_rng(0).bytes(size)):
        data = memoryview(zstd.compress(content, level))
        check_zstd(data, size)
        for other in (size - 1, size + 1):
            with pytest.raises(SchemaError, match=f"zstd data holds {size} bytes instead of {other}"):
                check_zstd(data, other)


def test_sizes_of_eight_bytes_are_read() -> None:
    head = b"\x28\xb5\x2f\xfd" + bytes([0xE0]) + struct.pack("<Q", 2**40)
    with pytest.raises(SchemaError, match=f"zstd data holds {2**40} bytes instead of 5"):
        check_zstd(memoryview(head), 5)


@pytest.mark.parametrize(
    ("data", "size", "reason"),
    [
        (b"", 1, "not zstd data: it begins with b''"),
        (FILES["png", "mono8"], 1, "not zstd data"),
        (b"\x28\xb5\x2f\xfd", 1, "zstd data cut off at 4 bytes"),
        (zstd.compress(bytes(70_000))[:7], 70_000, "zstd data cut off at 7 bytes"),
        (b"\x28\xb5\x2f\xfd\x00\x58", 1, "zstd data holds an unknown number of bytes instead of 1"),
        (b"\x28\xb5\x2f\xfd\x21\x05\x01", 1, "zstd data that needs a dictionary"),
        (b"\x28\xb5\x2f\xfd\x28\x01", 1, "its header has a reserved bit"),
        (zstd.compress(b""), MAX_DECODED_BYTES + 1, f"{MAX_DECODED_BYTES + 1} bytes to be decoded, at most"),
    ],
)
def test_other_data_is_refused(data: bytes, size: int, reason: str) -> None:
    with pytest.raises(SchemaError, match=reason):
        check_zstd(memoryview(data), size)


@given(st.binary(max_size=30).map(lambda end: b"\x28\xb5\x2f\xfd" + end))
def test_arbitrary_zstd_headers(data: bytes) -> None:
    try:
        check_zstd(memoryview(data), 5)
    except SchemaError:
        return
    assert zstd.get_frame_info(data + bytes(20)).decompressed_size == 5
