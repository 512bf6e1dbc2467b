"""Objects whose pixels have not all a reading."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from services.cloud.outlines import in_window, trusted
from services.cloud.shape import Box, Level, fit_box
from services.cloud.visible import Seen, shapes
from services.geometry.masks import Window
from tests.services.cloud.scenes import WIDTH, Cuboid, camera_view

LEVEL = Level.of(np.array([0.0, -1.0, 0.0]))
FAR = Cuboid((6.0, 0.6), (0.9, 1.2, 1.1), yaw=0.3)
NOISE = 0.009
"""Of inverse depth: 0.3 m at 6 m."""


def view(box: Cuboid, *, noise: float = 0.0) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    picture, owners = camera_view((box,))
    inverse = 1 / picture[..., 2:] + noise * np.random.default_rng(1).standard_normal((*owners.shape, 1))
    return picture / picture[..., 2:] / inverse, owners == 1


def shape(picture: NDArray[Any], mask: NDArray[np.bool_], read: NDArray[np.bool_]) -> tuple[NDArray[Any], Box]:
    rows, columns = np.nonzero(mask)
    top, left = int(rows.min()), int(columns.min())
    window = Window(top, left, mask[top : rows.max() + 1, left : columns.max() + 1])
    at = np.flatnonzero(read)
    xyz = picture.reshape(-1, 3)[at].T.astype(np.float32)
    ((centroid, box),) = shapes([Seen(window, trusted(window), in_window(at, WIDTH, window), xyz)], LEVEL)
    return centroid, box


def test_noise_does_not_make_a_far_box_larger() -> None:
    picture, mask = view(FAR, noise=NOISE)
    centroid, box = shape(picture, mask, mask)
    exact, _ = view(FAR)
    readings = fit_box(picture[mask].T.astype(np.float32), LEVEL)
    assert np.abs(np.sort(readings.size) / np.sort(FAR.size) - 1).max() > 0.3
    assert sorted(box.size) == pytest.approx(sorted(FAR.size), rel=0.2)
    assert centroid == pytest.approx(exact[mask].mean(axis=0), abs=0.03)
    assert np.ptp(picture[mask][:, 2]) > 2


def test_what_has_no_reading_counts_in_the_middle_and_in_the_size() -> None:
    picture, mask = view(FAR, noise=NOISE)
    read = mask & (np.cumsum(mask, axis=0) > 0.25 * mask.sum(axis=0))  # nothing of the top
    centroid, box = shape(picture, mask, read)
    exact, _ = view(FAR)
    assert centroid == pytest.approx(exact[mask].mean(axis=0), abs=0.1)
    assert box.size[2] == pytest.approx(FAR.size[2], rel=0.1)


def test_near_ones_are_as_large_as_their_readings_say() -> None:
    near = Cuboid((3.5, 0.2), (0.5, 0.4, 0.6), yaw=0.5)
    picture, mask = view(near)
    _, box = shape(picture, mask, mask)
    assert sorted(box.size) == pytest.approx(sorted(near.size), rel=0.05)


def test_a_handful_of_readings_and_none_without_one() -> None:
    picture, mask = view(FAR)
    rows, columns = np.nonzero(mask)
    few = np.zeros_like(mask)
    few[rows[:12], columns[:12]] = True
    centroid, box = shape(picture, few, few)
    assert centroid == pytest.approx(picture[few].mean(axis=0), abs=1e-5)
    assert np.isfinite(box.size).all()


def test_no_objects_have_no_shapes() -> None:
    assert shapes([], LEVEL) == []
