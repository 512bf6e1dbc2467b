"""Images of every encoding from Debian's rospy, through a real gateway, to a subscriber on Zenoh."""

from collections.abc import AsyncIterator

import pytest

from schemas.image import DEPTH_ENCODINGS, ImageFrame
from schemas.keys import CameraKey, Stream
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import PEERS, RosEnvironment

SCRIPT = (PEERS / "rospy_encodings.py").read_text(encoding="utf-8")
WIDTH = 4
BYTES_PER_PIXEL = {
    "rgb8": 3,
    "bgr8": 3,
    "rgba8": 4,
    "bgra8": 4,
    "mono8": 1,
    "mono16": 2,
    "yuv422": 2,
    "16UC1": 2,
    "32FC1": 4,
    **{f"bayer_{order}8": 1 for order in ("rggb", "bggr", "gbrg", "grbg")},
    **{f"bayer_{order}16": 2 for order in ("rggb", "bggr", "gbrg", "grbg")},
}
IMAGES = [
    (encoding, bigendian)
    for encoding in BYTES_PER_PIXEL
    for bigendian in ((False, True) if encoding.endswith(("16", "C1")) else (False,))
]


def step(encoding: str) -> int:
    """Return the bytes of a row, whose last four are padding."""
    return WIDTH * BYTES_PER_PIXEL[encoding] + 4


def data(encoding: str) -> bytes:
    return bytes(range(2 * step(encoding)))


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


@pytest.mark.timeout(120)
async def test_every_encoding_arrives_as_it_was_sent(ros: RosEnvironment, rig: FleetRig) -> None:
    streams = [
        CameraKey("r1", f"c{number}").stream(Stream.DEPTH if encoding in DEPTH_ENCODINGS else Stream.COLOR)
        for number, (encoding, _) in enumerate(IMAGES)
    ]
    topics = [f"/c{number}/image_raw" for number in range(len(IMAGES))]
    said = (f"{encoding}:{WIDTH}:{step(encoding)}:{int(big)}:{data(encoding).hex()}" for encoding, big in IMAGES)
    sent = (f"{topic}={image}" for topic, image in zip(topics, said, strict=True))
    await (await ros.script(SCRIPT, *sent)).until_output("encodings up")
    named = [f"{stream.removeprefix('fleet/r1/')}={topic}" for stream, topic in zip(streams, topics, strict=True)]
    options = [part for each in named for part in ("--topics", each)]
    await rig.gateway("r1", ros.master_uri, {}, *options, "--compression", "raw", "--no-results")
    for stream, (encoding, bigendian) in zip(streams, IMAGES, strict=True):
        async with rig.subscribed(stream) as samples:
            frame = await receive(samples, ImageFrame)
        shape = (frame.height, frame.width, frame.step)
        assert (frame.encoding, frame.is_bigendian, *shape) == (encoding, bigendian, 2, WIDTH, step(encoding))
        assert bytes(frame.data) == data(encoding)
