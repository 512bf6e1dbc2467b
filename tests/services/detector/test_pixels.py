import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.image import BYTES_PER_PIXEL, ImageFrame
from services.detector.pixels import to_bgr
from tests.schemas.frames import header

BGR = np.array([[[1, 2, 3], [4, 5, 6]], [[7, 8, 9], [250, 251, 252]], [[0, 0, 255], [255, 0, 0]]], np.uint8)
ALPHA = np.full((3, 2, 1), 9, np.uint8)
ENCODED = {
    "bgr8": BGR,
    "rgb8": BGR[..., ::-1],
    "bgra8": np.concatenate([BGR, ALPHA], 2),
    "rgba8": np.concatenate([BGR[..., ::-1], ALPHA], 2),
}


def frame(encoding: str, pixels: NDArray[np.uint8], padding: int) -> ImageFrame:
    rows = np.ascontiguousarray(pixels).reshape(3, -1)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    return ImageFrame(
        header=header(), height=3, width=2, encoding=encoding, step=padded.shape[1], data=memoryview(padded.tobytes())
    )


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("encoding", ENCODED)
def test_every_colour_order_and_row_pitch_gives_the_same_picture(encoding: str, padding: int) -> None:
    made = to_bgr(frame(encoding, ENCODED[encoding], padding))
    assert made.flags.c_contiguous
    assert np.array_equal(made, BGR)


@pytest.mark.parametrize("padding", [0, 5])
def test_grey_is_the_same_in_every_channel(padding: int) -> None:
    made = to_bgr(frame("mono8", BGR[..., :1], padding))
    assert np.array_equal(made, np.repeat(BGR[..., :1], 3, 2))


def test_every_encoding_of_the_contract_is_covered() -> None:
    assert set(BYTES_PER_PIXEL) == {*ENCODED, "mono8"}
