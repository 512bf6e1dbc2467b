import struct

import numpy as np
import pytest

from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.stream import MALFORMED
from schemas.image import ImageFrame
from tests.gateway.sensing import STAMP_NS, compressed
from tests.gateway.to_bus.translators.rvl_coding import rvl_of
from tests.gateway.to_bus.translators.translating import dropped, translated
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
        compressed("16UC1; compressedDepth png", file_of(DEEP, ".png")[1:]),
        compressed("32FC1; png compressed ", file_of(DEEP, ".png")),
        compressed("32FC1; compressedDepth png", file_of(DEEP, ".png")),
        compressed("bgr8; rvl", file_of(COLOR, ".jpg")),
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


@pytest.mark.parametrize("said", ["16UC1; compressedDepth png", "; compressedDepth png", "16UC1; compressedDepth rvl"])
def test_a_png_file_is_one_without_what_its_transport_puts_before_it(said: str) -> None:
    made = translated(ImageFrame, "front/depth", compressed(said, file_of(DEEP, ".png")))
    assert (made.format, made.encoding, made.inverse_depth) == ("png", "16UC1", None)
    assert bytes(made.data) == file_of(DEEP, ".png")


@pytest.mark.parametrize("said", ["png", "", "16UC1; png compressed ", "compressedDepth png"])
def test_a_png_file_is_one_with_what_another_transport_puts_before_it(said: str) -> None:
    made = translated(ImageFrame, "front/depth", compressed(said, bytes(12) + file_of(DEEP, ".png")))
    assert (made.format, made.encoding, made.inverse_depth) == ("png", "16UC1", None)
    assert bytes(made.data) == file_of(DEEP, ".png")


def test_rvl_becomes_the_millimetres_that_it_is_made_of() -> None:
    made = translated(ImageFrame, "front/depth", compressed("16UC1; compressedDepth rvl", bytes(12) + rvl_of(DEEP)))
    assert (made.header.stamp_ns, made.header.frame_id) == (STAMP_NS, "lens")
    assert (made.format, made.encoding, made.height, made.width, made.step) == ("raw", "16UC1", 4, 6, 12)
    assert bytes(made.data) == DEEP.astype("<u2").tobytes()


def test_rvl_becomes_the_metres_that_it_was_quantized_from() -> None:
    numbers = np.array([[0, 1, 40, 65535]], np.uint16)
    sent = struct.pack("<iff", 0, 100.0, -10.0) + rvl_of(numbers)
    made = translated(ImageFrame, "front/depth", compressed("32FC1; compressedDepth rvl", sent))
    assert (made.format, made.encoding, made.step, made.inverse_depth) == ("raw", "32FC1", 16, None)
    metres = np.frombuffer(made.data, "<f4")
    np.testing.assert_array_equal(metres, np.array([np.nan, 100 / 11, 2, 100 / 65545], np.float32))


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
        compressed("16UC1; compressedDepth rvl", bytes(12) + rvl_of(DEEP)[:-4]),
    ],
)
def test_a_picture_is_no_depth(message: Message) -> None:
    assert dropped("front/depth", message) == {MALFORMED: 1}
