import msgspec
import numpy as np
import pytest
from backports import zstd

from gateway.to_bus.shaping.compression import AUTO, LOSSLESS, LOSSY, NONE, Method, compress, parse_method
from gateway.to_bus.shaping.scaling import pixels_of
from schemas import codec
from schemas.image import BYTES_PER_PIXEL, DEPTH_ENCODINGS, ImageFrame
from schemas.points import PointCloud
from tests.gateway.to_bus.shaping.frames import cloud, decoded, frame, picture
from tests.schemas.pictures import compressed, file_of

PNG = Method("png")
BYTES = {encoding: size for encoding, size in BYTES_PER_PIXEL.items() if encoding != "yuv422"}
COLOURS = {
    "rgb8": [0, 1, 2],
    "bgr8": [2, 1, 0],
    "rgba8": [0, 1, 2, 3],
    "bgra8": [2, 1, 0, 3],
}


def colours(encoding: str, padding: int = 0) -> ImageFrame:
    opaque = np.dstack([picture(), np.full((48, 64), 255, np.uint8)])
    return frame(encoding, opaque[..., COLOURS[encoding]], padding=padding)


def sent(made: ImageFrame | PointCloud) -> ImageFrame:
    """Return what a receiver decodes."""
    assert isinstance(made, ImageFrame)
    return codec.decode(ImageFrame, codec.encode(made), codec.encoding(ImageFrame))


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("encoding", COLOURS)
def test_colours_are_the_same_in_a_jpeg_whatever_their_order(encoding: str, padding: int) -> None:
    made, method = compress(colours(encoding, padding), LOSSY)
    arrived = sent(made)
    assert (arrived.format, arrived.encoding, arrived.step, str(method)) == ("jpeg", "rgb8", 192, "jpeg:80")
    assert np.abs(decoded(arrived).astype(int) - picture()).max() <= 8


@pytest.mark.parametrize("padding", [0, 5])
def test_grey_is_a_grey_jpeg(padding: int) -> None:
    grey = picture()[..., 0]
    arrived = sent(compress(frame("mono8", grey, padding=padding), LOSSY)[0])
    assert (arrived.format, arrived.encoding) == ("jpeg", "mono8")
    assert decoded(arrived).shape == (48, 64)
    assert np.abs(decoded(arrived).astype(int) - grey).max() <= 4


def test_yuv422_is_a_jpeg_with_its_blacks_and_whites() -> None:
    uyvy = np.full((16, 32, 2), 128, np.uint8)
    uyvy[:, :16, 1], uyvy[:, 16:, 1] = 16, 235
    arrived = sent(compress(frame("yuv422", uyvy), LOSSY)[0])
    assert (arrived.encoding, arrived.step) == ("rgb8", 96)
    assert decoded(arrived)[:, 2:14].max() <= 1
    assert decoded(arrived)[:, 18:30].min() >= 254
    uyvy[..., 1], uyvy[:, 0::2, 0], uyvy[:, 1::2, 0] = 81, 90, 240
    red = decoded(sent(compress(frame("yuv422", uyvy), LOSSY)[0]))
    assert np.abs(red.astype(int) - [254, 0, 0]).max() <= 3


def test_quality_is_worth_bytes() -> None:
    noise = frame("rgb8", np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8))
    small, large = (compress(noise, Method("jpeg", quality))[0] for quality in (20, 95))
    assert small.data.nbytes * 2 < large.data.nbytes


@pytest.mark.parametrize(
    "encoding", sorted(DEPTH_ENCODINGS | {name for name in BYTES if "bayer" in name or "16" in name})
)
@pytest.mark.parametrize("is_bigendian", [False, True])
def test_what_a_jpeg_would_ruin_arrives_as_it_was(encoding: str, *, is_bigendian: bool) -> None:
    kind = {1: np.uint8, 2: np.uint16, 4: np.float32}[BYTES[encoding]]
    before = frame(encoding, np.arange(48 * 64).reshape(48, 64).astype(kind), padding=3, is_bigendian=is_bigendian)
    made, method = compress(before, LOSSY)
    arrived = sent(made)
    assert (arrived.format, arrived.encoding, method) == ("zstd", encoding, LOSSLESS)
    assert msgspec.structs.replace(arrived, format="raw", data=memoryview(zstd.decompress(arrived.data))) == before


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize(
    "encoding", sorted(name for name in BYTES if BYTES[name] <= 2 or name in COLOURS if name != "32FC1")
)
def test_a_png_holds_every_pixel(encoding: str, *, is_bigendian: bool) -> None:
    if encoding in COLOURS:
        before = colours(encoding, padding=2)
        expected = np.dstack([picture(), np.full((48, 64), 255, np.uint8)])[..., : len(COLOURS[encoding])]
    else:
        kind = np.uint8 if BYTES[encoding] == 1 else np.uint16
        expected = np.arange(48 * 64).reshape(48, 64).astype(kind)
        before = frame(encoding, expected, padding=2, is_bigendian=is_bigendian)
    made, method = compress(before, PNG)
    arrived = sent(made)
    assert (arrived.format, method) == ("png", PNG)
    assert arrived.encoding == {"bgr8": "rgb8", "bgra8": "rgba8"}.get(encoding, encoding)
    assert np.array_equal(decoded(arrived), expected)


@pytest.mark.parametrize(("encoding", "kind"), [("32FC1", np.float32), ("yuv422", np.uint16)])
def test_what_a_png_cannot_hold_becomes_zstd(encoding: str, kind: type) -> None:
    before = frame(encoding, np.ones((4, 6), kind))
    made, method = compress(before, PNG)
    assert method == LOSSLESS
    assert zstd.decompress(sent(made).data) == bytes(before.data)


def test_raw_is_the_frame_itself() -> None:
    before = colours("bgr8")
    made, method = compress(before, NONE)
    assert made is before
    assert str(method) == "raw"


@pytest.mark.parametrize("method", [LOSSY, PNG, LOSSLESS])
def test_what_arrived_compressed_stays_so(method: Method) -> None:
    file = compressed(file_of(picture(4, 6), ".png"), "rgb8", 18)
    made, how = compress(file, method)
    assert made is file
    assert str(how) == "png"


@pytest.mark.parametrize("asked", [LOSSY, PNG, LOSSLESS, Method("zstd", 3)])
def test_points_are_compressed_without_loss(asked: Method) -> None:
    made, method = compress(cloud(), asked)
    assert isinstance(made, PointCloud)
    arrived = codec.decode(PointCloud, codec.encode(made), codec.encoding(PointCloud))
    assert arrived.format == method.format == "zstd"
    assert zstd.decompress(arrived.data) == bytes(cloud().data)
    assert arrived.data.nbytes < cloud().data.nbytes


def test_pixels_are_a_view() -> None:
    before = colours("rgb8", padding=3)
    assert np.shares_memory(pixels_of(before), np.frombuffer(before.data, np.uint8))


@pytest.mark.parametrize(
    ("text", "method"),
    [
        ("auto", Method(AUTO)),
        ("raw", NONE),
        ("png", PNG),
        ("jpeg", Method("jpeg", 80)),
        ("jpeg:1", Method("jpeg", 1)),
        ("jpeg:100", Method("jpeg", 100)),
        ("zstd", Method("zstd", 1)),
        ("zstd:19", Method("zstd", 19)),
    ],
)
def test_methods_are_read(text: str, method: Method) -> None:
    assert parse_method(text) == method


@pytest.mark.parametrize("text", ["", "gif", "jpeg:", "jpeg:0", "jpeg:101", "zstd:20", "png:3", "raw:1", "jpeg:x"])
def test_other_texts_are_no_methods(text: str) -> None:
    with pytest.raises(ValueError, match=r"is not one of auto, raw|goes from 1 to"):
        parse_method(text)
