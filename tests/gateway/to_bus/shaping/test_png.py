import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.to_bus.shaping.compression import encode_png
from tests.gateway.to_bus.shaping.frames import picture

RGB_TO_BGR = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}


@given(
    st.tuples(st.integers(1, 20), st.integers(1, 20)),
    st.sampled_from([1, 3, 4]),
    st.sampled_from([np.uint8, np.uint16]),
    st.sampled_from(["noise", "steps", "still"]),
    st.integers(0, 99),
)
def test_another_program_reads_the_same_pixels(
    size: tuple[int, int], channels: int, kind: type, look: str, seed: int
) -> None:
    height, width = size
    pixels = np.random.default_rng(seed).integers(0, np.iinfo(kind).max, (height, width, channels), kind, endpoint=True)
    if look == "steps":
        pixels = np.cumsum(pixels // 64, axis=seed % 2).astype(kind)
    if look == "still":
        pixels[:] = pixels[0, 0]
    found = cv2.imdecode(np.frombuffer(encode_png(pixels), np.uint8), cv2.IMREAD_UNCHANGED)
    assert found is not None
    assert found.dtype == kind
    assert np.array_equal(found.reshape(pixels.shape), pixels[..., RGB_TO_BGR[channels]])


@pytest.mark.parametrize("order", ["<u2", ">u2"])
def test_either_byte_order_is_read(order: str) -> None:
    pixels = np.array([[[1], [256]]], order)
    found = cv2.imdecode(np.frombuffer(encode_png(pixels), np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.asarray(found).tolist() == [[1, 256]]


def test_filters_make_smooth_pictures_small() -> None:
    assert len(encode_png(picture(480, 640))) < picture(480, 640).nbytes / 20
