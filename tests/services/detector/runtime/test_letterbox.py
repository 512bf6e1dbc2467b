import numpy as np
import pytest

from services.detector.runtime.letterbox import PADDING, Letterbox


@pytest.mark.parametrize(
    ("height", "width", "longest", "shape"),
    [
        (480, 640, 320, (256, 320)),
        (480, 640, 640, (480, 640)),
        (640, 480, 640, (640, 480)),
        (720, 1280, 640, (384, 640)),
        (333, 600, 320, (192, 320)),
        (1, 1, 320, (320, 320)),
        (3, 3000, 320, (32, 320)),
        (480, 640, 500, (384, 512)),
        (640, 480, 33, (64, 32)),
    ],
)
def test_the_input_is_the_smallest_multiple_of_the_stride(
    height: int, width: int, longest: int, shape: tuple[int, int]
) -> None:
    letterbox = Letterbox.fit(height, width, longest, 32)
    assert letterbox.shape == shape
    out = np.zeros((*shape, 3), np.uint8)
    letterbox.apply(np.full((height, width, 3), (1, 2, 3), np.uint8), out)
    content = np.all(out == (3, 2, 1), axis=2)
    assert content.sum() == letterbox.rows.content * letterbox.columns.content
    assert np.all(out[~content] == PADDING)


def test_places_come_back_to_where_they_were() -> None:
    letterbox = Letterbox.fit(480, 640, 320, 32)
    assert (letterbox.rows.before, letterbox.columns.before) == (8, 0)
    rows = letterbox.rows.to_image(np.array([[0, 8], [128, 248], [250, 256]], np.float32))
    assert rows.tolist() == [[0, 0], [240, 480], [480, 480]]
