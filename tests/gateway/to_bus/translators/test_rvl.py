import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray

from gateway.to_bus.translators.rvl import MAX_PIXELS, decode_rvl
from schemas.errors import SchemaError
from tests.gateway.to_bus.translators.rvl_coding import rvl_of, words_of

HOLES = st.sampled_from([0, 0, 0, 1, 500, 501, 65535])
IMAGES = arrays(np.uint16, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=HOLES | st.integers(0, 65535))


def decoded(data: bytes) -> NDArray[np.uint16]:
    return decode_rvl(memoryview(data))


def test_an_image_that_was_written_by_hand() -> None:
    # 2 without a reading, 3 with: 8 = 0 + 8, 7 = 8 - 1, 7 = 7 + 0; 1 without, 0 with. In nibbles 2, 3, 82, 1, 0, 1, 0.
    assert decoded(struct.pack("<IIII", 3, 2, 0x23821010, 0)).tolist() == [[0, 0, 8], [7, 7, 0]]


@given(depth=IMAGES)
def test_what_is_encoded_is_decoded(depth: NDArray[np.uint16]) -> None:
    assert np.array_equal(decoded(rvl_of(depth)), depth)


def test_a_scene_with_holes() -> None:
    down, across = np.mgrid[0:120, 0:160]
    depth = (2_000 + across * 5 + down + np.random.default_rng(1).integers(-9, 9, (120, 160))).astype(np.uint16)
    depth[np.random.default_rng(2).random(depth.shape) < 0.1] = 0
    depth[40:60, 30:90] = 0
    assert np.array_equal(decoded(rvl_of(depth)), depth)


def test_runs_of_no_length_add_nothing() -> None:
    numbers = [1, 0, 0, 0, 0, 2, 10, 10, 0, 0, 0, 1, 1]
    assert decoded(struct.pack("<II", 4, 1) + words_of(iter(numbers))).tolist() == [[0, 5, 10, 9]]


WHOLE = rvl_of(np.arange(12, dtype=np.uint16).reshape(3, 4) * 1_000)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"1234567", "cut off at 7 bytes"),
        (WHOLE[:8], "cut off after 0 of 12 pixels"),
        (WHOLE[:-4], "runs over 12 pixels of 12"),
        (struct.pack("<II", 4, 4) + WHOLE[8:], "cut off after 12 of 16 pixels"),
        (struct.pack("<II", 4, 2) + WHOLE[8:], "runs over 12 pixels of 8"),
        (struct.pack("<II", 0, 4) + WHOLE[8:], "0x4 pixels"),
        (struct.pack("<II", 2**32 - 1, 2**32 - 1), "4294967295x4294967295 pixels"),
        (struct.pack("<II", 16_384, MAX_PIXELS // 16_384 + 1), f"at most {MAX_PIXELS} are decoded"),
        (struct.pack("<III", 1, 1, 0) * 99, "more than 18 numbers"),
        (struct.pack("<IIII", 1, 1, 0xFFFFFFFF, 0xFFF00000), "more than 10 nibbles"),
    ],
)
def test_what_is_refused_is_named(data: bytes, reason: str) -> None:
    with pytest.raises(SchemaError, match=reason):
        decoded(data)
