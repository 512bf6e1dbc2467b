import pytest

from gateway.ros1.image import TYPE_NAME, Image, encode_image
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.stream import MALFORMED
from schemas.image import BYTES_PER_PIXEL, DEPTH_ENCODINGS, ImageFrame
from tests.gateway.sensing import received
from tests.gateway.to_bus.translators.translating import dropped, translated

UNNAMED = {"8UC1": "mono8", "8UC3": "bgr8", "8UC4": "bgra8"}


def image(encoding: str, *, is_bigendian: bool = False) -> Message:
    step = 2 * BYTES_PER_PIXEL[UNNAMED.get(encoding, encoding)]
    return received(
        TYPE_NAME, encode_image(Image(1, 2, 3, "lens", 1, 2, encoding, is_bigendian, step, memoryview(bytes(step))))
    )


@pytest.mark.parametrize("encoding", BYTES_PER_PIXEL)
def test_every_encoding_is_an_image(encoding: str) -> None:
    stream, other = ("depth", "color") if encoding in DEPTH_ENCODINGS else ("color", "depth")
    made = translated(ImageFrame, f"front/{stream}", image(encoding, is_bigendian=True))
    if encoding != "mono16":  # as depth it is millimetres
        assert dropped(f"front/{other}", image(encoding)) == {MALFORMED: 1}
    assert (made.encoding, made.is_bigendian, made.step) == (encoding, True, 2 * BYTES_PER_PIXEL[encoding])
    assert (made.header.stamp_ns, made.header.frame_id, made.header.received_ns) == (2_000_000_003, "lens", 99)


@pytest.mark.parametrize(("encoding", "shown"), UNNAMED.items())
def test_bytes_without_a_meaning_are_the_colours_that_ros_shows_them_as(encoding: str, shown: str) -> None:
    made = translated(ImageFrame, "front/color", image(encoding))
    assert (made.encoding, made.step) == (shown, 2 * BYTES_PER_PIXEL[shown])


@pytest.mark.parametrize("encoding", [*BYTES_PER_PIXEL, *UNNAMED])
def test_only_some_are_depth(encoding: str) -> None:
    if encoding in DEPTH_ENCODINGS:
        assert translated(ImageFrame, "front/depth", image(encoding)).encoding == encoding
    elif encoding == "mono16":  # as compressed depth is often called, and raw depth by some drivers
        assert translated(ImageFrame, "front/depth", image(encoding)).encoding == "16UC1"
    else:
        assert dropped("front/depth", image(encoding)) == {MALFORMED: 1}
