"""Whatever a ROS publisher sends, a stream makes a valid frame of it or counts it as malformed."""

from hypothesis import given
from hypothesis import strategies as st

from gateway.ros1.image import Image, encode_image
from gateway.stream import MALFORMED, StreamForward
from gateway.translators import IMAGE_TRANSLATOR
from schemas import codec
from schemas.image import BYTES_PER_PIXEL, ImageFrame
from schemas.keys import CameraKey, Stream

uint32 = st.integers(0, 2**32 - 1)
small = st.integers(0, 8)
images = st.builds(
    Image,
    seq=uint32,
    stamp_s=uint32,
    stamp_ns=uint32,
    frame_id=st.text(max_size=20),
    height=small | uint32,
    width=small | uint32,
    encoding=st.sampled_from([*sorted(BYTES_PER_PIXEL), ""]) | st.text(max_size=10),
    is_bigendian=st.booleans(),
    step=small | uint32,
    data=st.binary(max_size=64).map(memoryview),
)


def take(message: bytes) -> None:
    forward = StreamForward(CameraKey("r1", "front"), Stream.COLOR, "/image", IMAGE_TRANSLATOR, "boot")
    payload = forward.take(message, "/camera", 0)
    status = forward.status(wanted=True, publishers=1, replaced=0, broken_links={})
    if payload is None:
        assert (status.forwarded, status.dropped) == (0, {MALFORMED: 1})
    else:
        assert (status.forwarded, status.dropped) == (1, {})
        codec.decode(ImageFrame, payload, codec.encoding(ImageFrame))


@given(st.binary(max_size=300))
def test_arbitrary_bytes(message: bytes) -> None:
    take(message)


@given(images)
def test_images_with_any_fields(image: Image) -> None:
    take(encode_image(image))


@given(images, st.data())
def test_images_with_bytes_changed_or_cut(image: Image, data: st.DataObject) -> None:
    message = bytearray(encode_image(image))
    message[data.draw(st.integers(0, len(message) - 1))] = data.draw(st.integers(0, 255))
    take(bytes(message[: data.draw(st.integers(0, len(message)))]))
