import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from services.simulator.film import smeared, streaks
from services.simulator.world import Camera, Drive, Pose, Rendering, generate, render

CAMERA = Camera()
MIDDLE = (CAMERA.height // 2, CAMERA.width // 2)


def looking(yaw_deg: float = 0.0, right: float = 0.0, ahead: float = 0.0) -> Pose:
    """Return a level camera so many metres beside and before the origin, that looks so far to the left of x."""
    return Pose.looking(ahead, -right, 0.0, float(np.radians(yaw_deg)))


def wall(metres: float) -> Rendering:
    """Return a view of a wall across the camera's axis, dark in its left half."""
    shape = (CAMERA.height, CAMERA.width)
    color = np.zeros((*shape, 3), np.uint8)
    color[:, MIDDLE[1] :] = 200
    return Rendering(np.full(shape, metres, np.float32), np.zeros(shape, np.int32), color)


def width(picture: NDArray[np.uint8]) -> float:
    """Return how many pixels the edge is wide in the middle row: an even slope of so many has its variance."""
    steps = np.diff(picture[MIDDLE[0], :, 0].astype(float))
    places = np.arange(len(steps))
    middle = np.average(places, weights=steps)
    return float(np.sqrt(12 * np.average((places - middle) ** 2, weights=steps)))


@pytest.mark.parametrize("degrees", [0.3, -0.5, 0.6])
def test_a_turn_smears_edges_along_the_rows_by_focal_length_times_its_angle(degrees: float) -> None:
    picture = smeared(wall(2.0), CAMERA, looking(-degrees / 2), looking(degrees / 2))
    assert width(picture) == pytest.approx(CAMERA.fx * np.radians(abs(degrees)), abs=0.3)
    assert picture[MIDDLE[0], :, 0].mean() == pytest.approx(100, abs=0.2)


def test_a_turn_leaves_what_runs_along_the_rows_sharp() -> None:
    seen = wall(2.0)
    seen.color[:] = 0
    seen.color[: MIDDLE[0]] = 200
    picture = smeared(seen, CAMERA, looking(-0.3), looking(0.3))
    assert np.array_equal(picture[:, MIDDLE[1]], seen.color[:, MIDDLE[1]])


@pytest.mark.parametrize(("metres", "pixels"), [(1.5, 6.2), (3.0, 3.1), (100.0, 0.0)])
def test_a_step_aside_smears_what_is_near_more_than_what_is_far(metres: float, pixels: float) -> None:
    picture = smeared(wall(metres), CAMERA, looking(right=-0.01), looking(right=0.01))
    assert width(picture) == pytest.approx(pixels, abs=0.3)


def test_what_is_kept_in_the_middle_by_a_turn_stays_sharp_there() -> None:
    angle = float(np.degrees(0.02 / 2.0))
    way = looking(-angle / 2, right=-0.01), looking(angle / 2, right=0.01)
    assert width(smeared(wall(2.0), CAMERA, *way)) < 0.3
    assert width(smeared(wall(4.0), CAMERA, *way)) == pytest.approx(CAMERA.fx * (0.02 / 2 - 0.02 / 4), abs=0.3)


def test_what_has_no_depth_is_smeared_by_turns_alone() -> None:
    across, _ = streaks(wall(0.0).depth, CAMERA, looking(-0.3, right=-0.1), looking(0.3, right=0.1))
    assert abs(across[MIDDLE]) == pytest.approx(CAMERA.fx * np.radians(0.6), rel=0.01)


def test_a_camera_at_rest_sees_what_is_there() -> None:
    seen = wall(0.3)
    assert np.array_equal(smeared(seen, CAMERA, looking(0.4), looking(0.4)), seen.color)


def test_no_streak_is_longer_than_a_degree() -> None:
    widths = [width(smeared(wall(2.0), CAMERA, looking(-half), looking(half))) for half in (0.6, 1.2, 12.0)]
    assert max(widths) < CAMERA.fx * np.radians(1)
    assert min(widths) > CAMERA.fx * np.radians(0.5)


@pytest.mark.parametrize("place", [0.05, 0.4, 0.9])
def test_streaks_are_how_far_surfaces_go_in_the_picture(place: float) -> None:
    scene = generate(704)
    drive = Drive.plan(scene)
    before, now, after = (drive.pose(place + metres / drive.length) for metres in (-0.004, 0.0, 0.004))
    depth = render(scene, now, CAMERA).depth
    rows, columns = np.indices(depth.shape)
    rays = np.stack([(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones(depth.shape)], axis=2)
    points = now.to_map(rays * depth[..., None])

    def projected(pose: Pose) -> NDArray[np.float64]:
        local = (points - pose.position) @ pose.rotation.astype(np.float64)
        return np.asarray(local[..., :2] / local[..., 2:] * (CAMERA.fx, CAMERA.fy))

    expected = projected(after) - projected(before)
    assert np.abs(expected).max() > 2
    assert np.abs(np.stack(streaks(depth, CAMERA, before, after), axis=2) - expected).max() < 0.1


@pytest.mark.parametrize("place", [0.4, 0.8, 0.9])
def test_a_picture_is_like_the_mean_of_what_is_seen_along_the_way(place: float) -> None:
    scene = generate(704)
    drive = Drive.plan(scene)
    way = [drive.pose(place + metres / drive.length) for metres in np.linspace(-0.005, 0.005, 9)]
    mean = np.mean([render(scene, pose, CAMERA).color for pose in way], axis=0)
    seen = render(scene, way[4], CAMERA)
    off, off_if_sharp = (
        np.abs(cv2.GaussianBlur(mean - each, (5, 5), 0.8)).mean()
        for each in (smeared(seen, CAMERA, way[0], way[-1]), seen.color)
    )
    assert off < 0.8 * off_if_sharp
