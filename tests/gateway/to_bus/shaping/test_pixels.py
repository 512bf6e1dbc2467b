import numpy as np
import pytest

from gateway.to_bus.shaping.scaling import pixels_of, with_pixels
from schemas.image import BYTES_PER_PIXEL, ImageFrame
from tests.schemas.frames import header

CHANNELS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "yuv422": 2}


@pytest.mark.parametrize("padding", [0, 1, 3])
@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("encoding", sorted(BYTES_PER_PIXEL))
def test_pixels_are_seen_in_place_and_put_back(encoding: str, padding: int, *, is_bigendian: bool) -> None:
    step = 4 * BYTES_PER_PIXEL[encoding] + padding
    data = np.arange(3 * step, dtype=np.uint8)
    frame = ImageFrame(
        header=header(),
        height=3,
        width=4,
        encoding=encoding,
        step=step,
        data=memoryview(data),  # type: ignore[arg-type]
        is_bigendian=is_bigendian,
    )
    pixels = pixels_of(frame)
    assert pixels.shape == (3, 4, CHANNELS.get(encoding, 1))
    assert np.shares_memory(pixels, data)
    last = bytes(frame.data)[step * 2 + step - padding - pixels.dtype.itemsize : 3 * step - padding]
    assert pixels[2, 3, -1:].tobytes() == last
    made = with_pixels(frame, pixels[1:])
    assert (made.height, made.width, made.step) == (2, 4, step - padding)
    assert bytes(made.data[: made.step]) == bytes(frame.data[step : 2 * step - padding])
