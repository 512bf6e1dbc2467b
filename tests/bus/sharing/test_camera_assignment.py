"""The owner of each camera."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.sharing.camera_assignment import owner
from schemas.keys import CameraKey
from schemas.worker_keys import WorkerAlive

FLEET = [CameraKey(f"r{robot}", f"c{camera}") for robot in range(8) for camera in range(8)]
CAMERAS = FLEET[::4]

names = st.from_regex(r"[a-z0-9]{1,8}", fullmatch=True)
workers = st.builds(
    WorkerAlive,
    st.just("detector"),
    names,
    st.floats(0.01, 1000),
    st.none() | st.sampled_from(["r0", "r1", "r2"]),
)
crews = st.sets(workers, min_size=1, max_size=8)


def owners(crew: set[WorkerAlive]) -> dict[CameraKey, str | None]:
    return {camera: owner(camera, crew) for camera in CAMERAS}


def crew_of(*weights: float, seed: int = 0) -> set[WorkerAlive]:
    return {WorkerAlive("detector", f"s{seed}-w{number}", weight) for number, weight in enumerate(weights)}


def test_without_workers_nobody_does() -> None:
    assert owner(CAMERAS[0], set()) is None


@given(crews)
def test_everybody_comes_to_the_same_end(crew: set[WorkerAlive]) -> None:
    assert owners(crew) == {camera: owner(camera, sorted(crew, key=str)) for camera in CAMERAS}


@given(crews, workers)
def test_who_joins_moves_only_what_it_takes(crew: set[WorkerAlive], joining: WorkerAlive) -> None:
    before, after = owners(crew), owners(crew | {joining})
    assert all(after[camera] in {before[camera], joining.worker} for camera in CAMERAS)


@given(st.sets(st.builds(WorkerAlive, st.just("detector"), names, st.floats(0.01, 1000)), min_size=2), st.data())
def test_who_leaves_moves_only_what_it_had(crew: set[WorkerAlive], data: st.DataObject) -> None:
    leaving = data.draw(st.sampled_from(sorted(crew, key=str)))
    left = {worker for worker in crew if worker.worker != leaving.worker}
    before, after = owners(crew), owners(left)
    assert all(after[camera] == before[camera] for camera in CAMERAS if before[camera] != leaving.worker)


@given(crews)
def test_who_is_for_a_robot_wins_it_and_gets_no_other(crew: set[WorkerAlive]) -> None:
    for camera, found in owners(crew).items():
        bound: set[str | None] = {worker.worker for worker in crew if worker.robot == camera.robot}
        free: set[str | None] = {worker.worker for worker in crew if worker.robot is None}
        assert found in (bound or free or {None})


def test_a_robot_without_workers_of_its_own_or_for_any_has_none() -> None:
    crew = {WorkerAlive("detector", "w1", robot="r1")}
    assert [owner(CameraKey(robot, "c1"), crew) for robot in ("r1", "r2")] == ["w1", None]


@pytest.mark.parametrize("weights", [(1, 1), (1, 3), (0.5, 2, 2.5), (1,) * 8])
def test_each_gets_its_weights_share(weights: tuple[float, ...]) -> None:
    cameras = [CameraKey(f"r{robot}", f"c{camera}") for robot in range(50) for camera in range(50)]
    found = Counter(owner(camera, crew_of(*weights)) for camera in cameras)
    for number, weight in enumerate(weights):
        share = weight / sum(weights)
        spread = (share * (1 - share) * len(cameras)) ** 0.5
        assert abs(found[f"s0-w{number}"] - share * len(cameras)) < 5 * spread


def test_of_64_cameras_no_worker_of_8_gets_more_than_two_and_a_half_times_the_even_share() -> None:
    for seed in range(200):
        found = Counter(owner(camera, crew_of(*[1.0] * 8, seed=seed)) for camera in FLEET)
        assert max(found.values()) <= 2.5 * 64 / 8
