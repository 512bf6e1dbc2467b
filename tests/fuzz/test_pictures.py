"""The size that is checked of a JPEG file is the size that libjpeg decodes it to, whatever stands before it."""

from random import Random

import cv2
import numpy as np
import simplejpeg

from schemas.compression import picture_of
from schemas.errors import SchemaError
from tests.fuzz.mutation import mutate
from tests.schemas.pictures import file_of

INPUTS = 20_000
LONGEST = 0xFFFF
BODY = (0x00, 0x03, 0x08, 0x11, 0xC0, 0xFF)


def seeds() -> list[bytes]:
    _, progressive = cv2.imencode(".jpg", np.zeros((9, 7, 3), np.uint8), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])
    grey, colour = np.zeros((4, 6), np.uint8), np.zeros((5, 8, 3), np.uint8)
    return [file_of(grey, ".jpg"), file_of(colour, ".jpg"), progressive.tobytes()]


def with_segments(rng: Random, files: list[bytes]) -> bytes:
    """Put segments of any kind in front of a file's own: they look like markers, or hold another file."""
    file, made = rng.choice(files), b""
    for _ in range(rng.randrange(4)):
        body = bytes(rng.choices(BODY, k=rng.randrange(30)))
        if rng.random() < 0.03:  # its length looks like more of the marker
            body = rng.choice(files)[2:].ljust(LONGEST - 2, b"\0")
        made += bytes([0xFF, rng.randrange(256)]) + (len(body) + 2).to_bytes(2, "big") + body
    return file[:2] + made + file[2:]


def test_decoders_see_the_size_that_was_checked() -> None:
    rng, files = Random(1), seeds()  # noqa: S311 - no secret
    agreed = 0
    for _ in range(INPUTS):
        data = with_segments(rng, files)
        if rng.random() < 0.5:
            data = mutate(rng, (data,))
        try:
            checked = picture_of(memoryview(data))
            decoded = simplejpeg.decode_jpeg_header(data)
        except (SchemaError, ValueError):
            continue
        assert decoded[:2] == (checked.height, checked.width), data.hex()
        agreed += 1
    assert agreed > INPUTS / 10
