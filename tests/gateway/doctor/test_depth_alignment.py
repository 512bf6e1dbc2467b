from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.doctor.depth_alignment import Placement, placement
from schemas.image import ImageFrame
from services.simulator.world import Camera
from tests.gateway.doctor.views import ALIGNED, PLACES, color, depth, frame
from tests.schemas.pictures import file_of


def clear(camera: Camera, aside: float = 0.0) -> list[Placement]:
    """Return how depth lies on colour wherever that is clear."""
    found = (placement(color(place), frame(depth(place, camera, aside), "16UC1")) for place in range(PLACES))
    return [each for each in found if each is not None]


def test_depth_that_lies_on_colour() -> None:
    found = clear(ALIGNED)
    assert found
    assert all(each.aligned for each in found)
    assert all(abs(each.right) <= 4 and abs(each.down) <= 4 and 0.96 <= each.scale <= 1.04 for each in found)


def test_lenses_side_by_side_are_aligned_as_far_as_can_be_seen() -> None:
    assert all(each.aligned for each in clear(ALIGNED, aside=0.02))


@pytest.mark.parametrize(
    ("camera", "scale", "right", "down"),
    [
        pytest.param(Camera(320, 240, 195, 195, 159.5, 119.5), 232.8 / 195, 0, 0, id="a wider lens"),
        pytest.param(Camera(320, 240, 290, 290, 159.5, 119.5), 232.8 / 290, 0, 0, id="a narrower lens"),
        pytest.param(Camera(320, 240, 232.8, 232.8, 169.5, 119.5), 1, -10, 0, id="shifted right"),
        pytest.param(Camera(320, 240, 232.8, 232.8, 159.5, 99.5), 1, 0, 20, id="shifted up"),
    ],
)
def test_depth_that_lies_elsewhere(camera: Camera, scale: float, right: int, down: int) -> None:
    found = clear(camera)
    assert found
    for each in found:
        assert not each.aligned
        assert each.scale == pytest.approx(scale, rel=0.05)
        assert each.right == pytest.approx(right, abs=8)
        assert each.down == pytest.approx(down, abs=8)


def test_depth_of_another_place_fits_nowhere() -> None:
    for place in range(PLACES):
        assert placement(color(place), frame(depth(place)[:, ::-1], "16UC1")) is None


def clear_place() -> int:
    return next(place for place in range(PLACES) if placement(color(place), frame(depth(place), "16UC1")))


METRES: dict[str, Callable[[NDArray[np.uint16]], ImageFrame]] = {
    "big-endian": lambda found: frame(found.astype(">u2"), "16UC1", is_bigendian=True),
    "padded rows": lambda found: frame(found, "16UC1", padding=6),
    "metres": lambda found: frame(np.where(found, found / 1000, np.nan).astype("<f4"), "32FC1"),
}


@pytest.mark.parametrize("made", METRES.values(), ids=METRES)
def test_depth_is_read_in_any_form(made: Callable[[NDArray[np.uint16]], ImageFrame]) -> None:
    place = clear_place()
    found = placement(color(place), made(depth(place)))
    assert found
    assert found.aligned


@pytest.mark.parametrize("encoding", ["bgr8", "rgba8", "mono8"])
def test_colour_is_read_in_any_plain_encoding(encoding: str) -> None:
    place = clear_place()
    rgb = np.frombuffer(color(place).data, np.uint8).reshape(240, 320, 3)
    pixels: Any = {
        "bgr8": rgb[..., ::-1],
        "rgba8": np.concatenate([rgb, np.full((240, 320, 1), 255, np.uint8)], 2),
        "mono8": rgb.mean(2).astype(np.uint8),
    }
    found = placement(frame(pixels[encoding], encoding, padding=5), frame(depth(place), "16UC1"))
    assert found
    assert found.aligned


def test_what_cannot_be_compared() -> None:
    place = clear_place()
    seen, measured = color(place), frame(depth(place), "16UC1")
    assert placement(seen, frame(depth(place)[:, :300], "16UC1")) is None
    assert placement(frame(depth(place), "mono16"), measured) is None
    assert placement(seen, frame(depth(place), "mono16")) is None
    small = frame(np.zeros((59, 80, 3), np.uint8), "rgb8"), frame(np.zeros((59, 80), np.uint16), "16UC1")
    assert placement(*small) is None


@pytest.mark.parametrize("value", [0, 1000])
def test_views_without_any_edge(value: int) -> None:
    grey = frame(np.full((240, 320, 3), 90, np.uint8), "rgb8")
    assert placement(grey, frame(np.full((240, 320), value, np.uint16), "16UC1")) is None
    assert placement(color(0), frame(np.full((240, 320), value, np.uint16), "16UC1")) is None


def test_pixels_in_a_file_are_not_read() -> None:
    file = file_of(np.zeros((240, 320, 3), np.uint8), ".jpg")
    jpeg = ImageFrame(
        header=color(0).header, height=240, width=320, encoding="rgb8", step=960, data=memoryview(file), format="jpeg"
    )
    assert placement(jpeg, frame(depth(0), "16UC1")) is None
