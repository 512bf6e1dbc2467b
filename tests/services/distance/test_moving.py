"""A robot that drives and turns between its depth image and its colour image: a box before a wall, exactly known."""

import math
from typing import Final

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.detections import Detections
from schemas.distances import Measured
from schemas.image import ImageFrame
from schemas.transforms import Transform, Transforms
from services.distance.depth_in_color_view import DepthLimits, Instant, Views
from services.distance.depth_readings import Criteria
from services.distance.measuring import DepthView, measure
from services.distance.sensor_history import ImageContext, SensorHistory
from services.geometry.rotation import inverse_of, matrix_of
from services.geometry.transforms import LITTLE
from services.worker.stamp_joiner import Joiner
from tests.services.distance.scenes import FOCAL, FRAME, HEIGHT, WIDTH, calibration, depth, detections, found, head

MS: Final = 1_000_000
TAKEN_NS: Final = 1_700_000_000_000_000_000
AT_ONCE: Final = 50 * MS
"""How far apart the images are at most."""

WALL_M, BOX_M = 4.0, 2.0
BOX_HALF = (0.1, 0.3)
DRIVING: Final = (1.5, 0.0)
TURNING: Final = (0.0, 1.5)
BOTH: Final = (1.0, -1.0)
Motion = tuple[float, float]
"""Metres a second forward, radians a second to the right."""


def pose(motion: Motion, after_ns: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where the camera is in odom, whose axes are those of the camera when the image is taken."""
    forward, turn = (each * after_ns / 1e9 for each in motion)
    return np.array([0, 0, forward]), np.array([0, math.sin(turn / 2), 0, math.cos(turn / 2)])


def seen(motion: Motion, after_ns: int) -> NDArray[np.float32]:
    """Return how far along its axis the camera sees, exactly: the box's face, or else the wall."""
    camera = matrix_of(*pose(motion, after_ns))
    rows, columns = np.indices((HEIGHT, WIDTH))
    ahead = np.ones((HEIGHT, WIDTH))
    rays = np.stack([(columns - (WIDTH - 1) / 2) / FOCAL, (rows - (HEIGHT - 1) / 2) / FOCAL, ahead], axis=-1)
    x, y, z = np.moveaxis(rays @ camera[:3, :3].T, -1, 0)
    to_box, to_wall = ((at - camera[2, 3]) / z for at in (BOX_M, WALL_M))
    on_box = (np.abs(x * to_box) <= BOX_HALF[0]) & (np.abs(y * to_box) <= BOX_HALF[1])
    return np.asarray(np.where(on_box, to_box, to_wall), np.float32)


def of_image() -> Detections:
    return detections(found(seen(DRIVING, 0) == BOX_M), stamp_ns=TAKEN_NS)


def of_depth(motion: Motion, after_ns: int) -> ImageFrame:
    return depth(seen(motion, after_ns), stamp_ns=TAKEN_NS + after_ns)


def odometry(motion: Motion, after_ns: int) -> Transforms:
    translation, rotation = (each.tolist() for each in pose(motion, after_ns))
    said = Transform(
        frame_id="odom",
        child_frame_id=FRAME,
        stamp_ns=TAKEN_NS + after_ns,
        translation=(*translation,),
        rotation=(*rotation,),
    )
    return Transforms(header=head(frame_id="", camera=""), transforms=[said])


def sensed(motion: Motion, after_ns: int, *, heard: tuple[int, ...]) -> SensorHistory:
    """Return what a robot that moves like this has said. heard: when its odometry was, from the image on."""
    made = SensorHistory((), Joiner("depth image", tolerance_ns=AT_ONCE), info=calibration(), depth_info=calibration())
    image = of_depth(motion, after_ns)
    for before_ns in (3 * AT_ONCE, 0):  # so that none is expected any nearer to the image
        made.depths.keep(image.header.stamp_ns - before_ns, image, image.data.nbytes)
    for at in heard:
        made.transforms.take(odometry(motion, at), static=False)
    return made


def measured(moment: ImageContext) -> Measured:
    assert isinstance(moment.instant, Instant)
    image, camera = Views(DepthLimits()).view(moment.instant)
    (only,) = measure(of_image().objects, DepthView(image, FRAME, camera), Criteria())
    assert only.measured is not None
    return only.measured


MOVING = pytest.mark.parametrize(
    ("motion", "after_ns"), [(DRIVING, AT_ONCE), (TURNING, -AT_ONCE), (TURNING, AT_ONCE), (BOTH, -AT_ONCE)]
)
ALL: Final = (-100 * MS, 0, 100 * MS)


@MOVING
def test_what_moves_between_depth_and_colour_is_where_it_was_when_the_image_was_taken(
    motion: Motion, after_ns: int
) -> None:
    known = measured(sensed(motion, after_ns, heard=ALL).at(of_image()))
    assert known.axial_m == pytest.approx(BOX_M, abs=0.005)
    (place,) = known.places
    assert place.at == pytest.approx((0, 0, BOX_M), abs=0.03)


@MOVING
@pytest.mark.parametrize("info", ["info", "depth_info"])
def test_one_calibration_is_enough_for_that(motion: Motion, after_ns: int, info: str) -> None:
    made = sensed(motion, after_ns, heard=ALL)
    setattr(made, info, None)
    assert measured(made.at(of_image())).axial_m == pytest.approx(BOX_M, abs=0.005)


@MOVING
def test_odometry_that_is_not_known_in_time_is_not_waited_for(motion: Motion, after_ns: int) -> None:
    for heard in ((), (-100 * MS, min(0, after_ns) - 1)):
        moment = sensed(motion, after_ns, heard=heard).at(of_image())
        assert isinstance(moment.instant, Instant)
        assert np.array_equal(moment.instant.color_from_depth, np.identity(4))
        assert not moment.open


def test_a_robot_that_hardly_moves_has_its_depth_taken_as_it_is() -> None:
    slow = (0.9 * LITTLE / AT_ONCE * 1e9, 0.0)
    moment = sensed(slow, AT_ONCE, heard=ALL).at(of_image())
    assert isinstance(moment.instant, Instant)
    assert np.array_equal(moment.instant.color_from_depth, np.identity(4))


def test_where_both_cameras_are_on_the_robot_counts_beside_how_it_moves() -> None:
    image = msgspec.structs.replace(of_depth(BOTH, AT_ONCE), header=head(frame_id="lens", stamp_ns=TAKEN_NS + AT_ONCE))
    made = sensed(BOTH, AT_ONCE, heard=ALL)
    made.depths.keep(image.header.stamp_ns, image, image.data.nbytes)
    beside = Transform(
        frame_id=FRAME, child_frame_id="lens", stamp_ns=0, translation=(0.02, 0, 0), rotation=(0, 0, 0, 1)
    )
    made.transforms.take(Transforms(header=head(camera=""), transforms=[beside]), static=True)
    moment = made.at(of_image())
    assert isinstance(moment.instant, Instant)
    true = inverse_of(matrix_of(*pose(BOTH, 0))) @ matrix_of(*pose(BOTH, AT_ONCE))
    true = true @ matrix_of(np.array([0.02, 0, 0]), np.array([0.0, 0, 0, 1]))
    assert moment.instant.color_from_depth == pytest.approx(true, abs=1e-4)
