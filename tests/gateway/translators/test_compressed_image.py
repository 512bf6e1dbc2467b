import struct

import numpy as np
import pytest

from gateway.ros1.subscriber import Message
from gateway.stream import MALFORMED
from schemas.image import ImageFrame
from tests.gateway.sensing import STAMP_NS, compressed
from tests.gateway.translators.translating import dropped, translated
from tests.schemas.pictures import file_of

GREY = np.arange(24, dtype=np.uint8).reshape(4, 6)
DEEP = np.arange(24, dtype=np.uint16).reshape(4, 6) * 1000
COLOR = np.zeros((4, 6, 3), np.uint8)


@pytest.mark.parametrize(
    ("said", "file", "kind", "encoding", "step"),
    [
        ("jpeg", file_of(COLOR, ".jpg"), "jpeg", "rgb8", 18),
        ("rgb8; jpeg compressed bgr8", file_of(COLOR, ".jpg"), "jpeg", "rgb8", 18),
        ("bgr8; jpeg compressed bgr8", file_of(COLOR, ".jpg"), "jpeg", "rgb8", 18),
        ("mono8; jpeg compressed ", file_of(GREY, ".jpg"), "jpeg", "mono8", 6),
        ("png", file_of(COLOR, ".png"), "png", "rgb8", 18),
        ("mono16; png compressed ", file_of(DEEP, ".png"), "png", "mono16", 12),
        ("bayer_rggb8; png compressed ", file_of(GREY, ".png"), "png", "bayer_rggb8", 6),
        ("", file_of(GREY, ".png"), "png", "mono8", 6),
    ],
)
def test_a_file_goes_on_as_it_is(said: str, file: bytes, kind: str, encoding: str, step: int) -> None:
    made = translated(ImageFrame, "front/color", compressed(said, file))
    assert (made.header.stamp_ns, made.header.frame_id) == (STAMP_NS, "lens")
    assert (made.height, made.width, made.format, made.encoding, made.step) == (4, 6, kind, encoding, step)
    assert bytes(made.data) == file


@pytest.mark.parametrize(
    "message",
    [
        compressed("jpeg", b""),
        compressed("jpeg", b"\xff\xd8"),
        compressed("webp", b"RIFF0000WEBP"),
        compressed("16UC1; compressedDepth png", bytes(11)),
        compressed("16UC1; compressedDepth png", file_of(DEEP, ".png")),
        compressed("32FC1; png compressed ", file_of(DEEP, ".png")),
    ],
)
def test_what_is_no_file_is_malformed(message: Message) -> None:
    assert dropped("front/color", message) == {MALFORMED: 1}


@pytest.mark.parametrize(
    "said", ["16UC1; compressedDepth png", "16UC1; compressedDepth", "mono16; compressedDepth png"]
)
def test_compressed_millimetres(said: str) -> None:
    made = translated(ImageFrame, "front/depth", compressed(said, bytes(12) + file_of(DEEP, ".png")))
    assert (made.format, made.encoding, made.step, made.inverse_depth) == ("png", "16UC1", 12, None)
    assert bytes(made.data) == file_of(DEEP, ".png")


@pytest.mark.parametrize("said", ["png", "", "mono16; png compressed ", "16UC1; png compressed "])
def test_sixteen_bits_on_a_depth_stream_are_millimetres_whatever_they_are_called(said: str) -> None:
    made = translated(ImageFrame, "front/depth", compressed(said, file_of(DEEP, ".png")))
    assert (made.format, made.encoding, made.step, made.inverse_depth) == ("png", "16UC1", 12, None)


def test_compressed_metres_say_how_they_were_quantized() -> None:
    sent = struct.pack("<iff", 0, 100.5, -2.25) + file_of(DEEP, ".png")
    made = translated(ImageFrame, "front/depth", compressed("32FC1; compressedDepth png", sent))
    assert (made.format, made.encoding, made.step, made.inverse_depth) == ("png", "32FC1", 24, (100.5, -2.25))


@pytest.mark.parametrize(
    "message",
    [
        compressed("jpeg", file_of(COLOR, ".jpg")),
        compressed("png", file_of(GREY, ".png")),
        compressed("bayer_rggb16; png compressed ", file_of(DEEP, ".png")),
        compressed("16UC1; compressedDepth png", bytes(12) + file_of(GREY, ".png")),
        compressed("; compressedDepth png", bytes(12) + file_of(DEEP, ".png")),
    ],
)
def test_a_picture_is_no_depth(message: Message) -> None:
    assert dropped("front/depth", message) == {MALFORMED: 1}
