"""Faces of boxes that are seen exactly, and through noise."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from services.cloud.surfaces import fit_faces
from tests.services.cloud.scenes import Cuboid, cast

EYE = np.array([0.0, 0.0, 1.5])


def seen(box: Cuboid, *, noise: float = 0.0, up: int = 18, across: int = 24) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return directions (3, 1, m), x ahead and z up, and inverse depths (1, m) of what of a box is in view."""
    bearing = np.arctan2(box.centre[1], box.centre[0])
    y, z = np.meshgrid(np.tan(bearing + np.linspace(-0.25, 0.25, across)), np.linspace(-0.6, 0.05, up))
    directions = np.stack([np.ones(y.size), y.ravel(), z.ravel()])
    ways, owners = cast(EYE, directions.T, (box,))
    inverse = 1 / ways[owners == 1]
    inverse += noise * np.random.default_rng(0).standard_normal(len(inverse))
    return directions[:, None, owners == 1], inverse[None]


@pytest.mark.parametrize("yaw", [-0.6, -0.2, 0.3, 0.7])
def test_of_a_box_two_upright_faces_and_the_top_are_found(yaw: float) -> None:
    directions, inverse = seen(Cuboid((3.0, 0.4), (0.8, 0.8, 0.9), yaw))
    faces = fit_faces(directions, inverse, np.ones(inverse.shape))
    found = faces.inverse_depth(directions.transpose(1, 0, 2))[0]
    assert np.median(np.abs(found / inverse[0] - 1)) < 0.01
    assert 1 / faces.forms[0, 2, 2] == pytest.approx(0.9 - EYE[2], abs=0.02)
    assert abs((faces.along[0] - yaw + np.pi / 4) % (np.pi / 2) - np.pi / 4) < np.radians(4)


def test_noise_does_not_make_a_far_face_deep() -> None:
    directions, inverse = seen(Cuboid((7.0, 0.0), (0.02, 1.6, 1.6), 0.0), noise=0.003)
    faces = fit_faces(directions, inverse, np.ones(inverse.shape))
    depth = 1 / faces.inverse_depth(directions.transpose(1, 0, 2))[0]
    assert np.ptp(1 / inverse) > 0.5
    assert np.ptp(depth) < 0.2
    assert faces.noise[0] == pytest.approx(0.003, rel=0.3)


def test_objects_are_fitted_each_by_itself_and_padding_is_nothing() -> None:
    one, other = (seen(Cuboid(centre, (0.8, 0.8, 0.9), 0.4)) for centre in ((3.0, 0.4), (4.0, -0.5)))
    size = max(one[1].size, other[1].size) + 7
    directions, inverse, weights = np.zeros((3, 2, size)), np.zeros((2, size)), np.zeros((2, size))
    for number, (aimed, measured) in enumerate((one, other)):
        directions[:, number, : measured.size] = aimed[:, 0]
        inverse[number, : measured.size] = measured[0]
        weights[number, : measured.size] = 1
    faces = fit_faces(directions, inverse, weights)
    for number, (aimed, measured) in enumerate((one, other)):
        found = faces.inverse_depth(np.repeat(aimed.transpose(1, 0, 2), 2, axis=0))[number]
        assert np.median(np.abs(found / measured[0] - 1)) < 0.01


def test_a_single_reading_has_faces_that_are_no_nonsense() -> None:
    faces = fit_faces(np.array([[[1.0]], [[0.1]], [[-0.2]]]), np.array([[0.5]]), np.ones((1, 1)))
    assert np.isfinite(faces.along).all()
    assert (faces.inverse_depth(np.array([[[1.0], [0.1], [-0.2]]])) > 0).all()


def test_a_box_that_rises_above_the_camera_has_no_top_that_is_seen() -> None:
    directions, inverse = seen(Cuboid((4.0, 0.3), (1.0, 0.9, 1.9), 0.4), noise=0.003)
    faces = fit_faces(directions, inverse, np.ones(inverse.shape))
    depth = 1 / faces.inverse_depth(directions.transpose(1, 0, 2))[0]
    assert np.abs(depth - 1 / inverse[0]).max() < 0.3
    assert not -1.0 < 1 / faces.forms[0, 2, 2] < 0.2  # none, or beyond its ends


def test_what_begins_at_the_cameras_own_height_has_no_underside_that_is_seen() -> None:
    y, z = np.meshgrid(np.linspace(-0.2, 0.2, 9), np.linspace(0, 0.3, 7))
    directions = np.stack([np.ones(y.size), y.ravel(), z.ravel()])[:, None]
    faces = fit_faces(directions, np.full((1, y.size), 0.5), np.ones((1, y.size)))
    assert faces.inverse_depth(directions.transpose(1, 0, 2)) == pytest.approx(0.5)


def test_a_face_that_is_taken_to_be_nearer_hides_less() -> None:
    directions, inverse = seen(Cuboid((3.0, 0.4), (0.8, 0.8, 0.9), 0.3))
    faces = fit_faces(directions, inverse, np.ones(inverse.shape))
    aimed = directions.transpose(1, 0, 2)
    nearer = faces.inverse_depth(aimed, np.array([[[0.0], [0.0], [0.1]]]))
    assert (nearer >= faces.inverse_depth(aimed)).all()
    assert (nearer > faces.inverse_depth(aimed)).any()
