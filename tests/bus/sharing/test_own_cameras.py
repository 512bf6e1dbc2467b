"""What one worker looks after, as others come and go."""

from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.sharing import camera_assignment, own_cameras
from bus.sharing.camera_assignment import IDLE_S, owner
from bus.sharing.own_cameras import OwnCameras
from schemas.keys import CameraKey
from schemas.worker_keys import Serves, WorkerAlive

CAMERAS = [CameraKey(f"r{robot}", f"c{camera}") for robot in range(4) for camera in range(4)]
MOST = 1000


def token(name: str) -> WorkerAlive:
    return WorkerAlive("detector", name)


def falls_to(name: str, *others: str) -> set[CameraKey]:
    crew = {token(each) for each in (name, *others)}
    return {camera for camera in CAMERAS if owner(camera, crew) == name}


def shares(name: str, *others: str, cameras: Iterable[CameraKey] = CAMERAS) -> OwnCameras:
    made = OwnCameras(name)
    for camera in cameras:
        made.camera(camera, alive=True)
    for each in (name, *others):
        made.worker(token(each), alive=True)
    for each in others:
        serve_all(made, each, falls_to(each, name, *others))
    made.plan(0, MOST)
    return made


def serve_all(made: OwnCameras, name: str, cameras: Iterable[CameraKey] = CAMERAS) -> None:
    for camera in cameras:
        made.taken(Serves("detector", name, camera), alive=True)


def test_what_falls_to_it_and_no_more() -> None:
    assert shares("a").plan(0, MOST) == set(CAMERAS)
    assert shares("a", "b").plan(0, MOST) == falls_to("a", "b")
    assert OwnCameras("a").plan(0, MOST) == frozenset()


def test_what_falls_to_another_stays_until_that_one_has_taken_it_over() -> None:
    made = shares("a")
    made.worker(token("b"), alive=True)
    assert made.plan(1, MOST) == set(CAMERAS)
    assert made.next_s == 1 + IDLE_S
    first, *rest = sorted(falls_to("b", "a"))
    assert made.taken(Serves("detector", "b", first), alive=True)
    assert made.plan(1.1, MOST) == set(CAMERAS) - {first}
    for camera in rest:
        made.taken(Serves("detector", "b", camera), alive=True)
    assert made.plan(1.2, MOST) == falls_to("a", "b")
    assert made.next_s is None


def test_what_another_leaves_idle_is_served_on_until_that_one_takes_it_over() -> None:
    made = shares("a")
    made.worker(token("b"), alive=True)
    made.plan(1, MOST)
    assert made.plan(0.999 + IDLE_S, MOST) == set(CAMERAS)
    assert made.handing_over
    assert made.plan(1 + IDLE_S, MOST) == set(CAMERAS)
    assert (made.handing_over, made.next_s) == (False, None), "b is passed over"
    serve_all(made, "b", falls_to("b", "a"))
    assert made.plan(2 + IDLE_S, MOST) == falls_to("a", "b")


def test_a_worker_of_great_weight_that_serves_nothing_is_passed_over_and_the_others_share_what_it_won() -> None:
    idle = WorkerAlive("detector", "idle", weight=1000)
    crew = {name: shares(name, *"ab".replace(name, "")) for name in "ab"}
    for made in crew.values():
        made.worker(idle, alive=True)
        made.plan(1, MOST)
    plans = {name: made.plan(1 + IDLE_S, MOST) for name, made in crew.items()}
    assert plans == {"a": falls_to("a", "b"), "b": falls_to("b", "a")}
    for made in crew.values():
        made.worker(idle, alive=False)
        made.worker(idle, alive=True)
    assert crew["a"].plan(2 + IDLE_S, MOST) == plans["a"], "it goes on until the new one has taken over"
    assert crew["a"].next_s == 2 + 2 * IDLE_S


def test_many_workers_of_great_weight_that_serve_nothing_cost_no_more_time_than_one() -> None:
    crew = {name: shares(name, *"ab".replace(name, "")) for name in "ab"}
    for made in crew.values():
        for number in range(200):
            made.worker(WorkerAlive("detector", f"idle{number}", weight=1000), alive=True)
        made.plan(1, MOST)
    for name, other in ("ab", "ba"):
        assert crew[name].plan(1 + IDLE_S, MOST) == falls_to(name, other)
        assert crew[name].plan(1.1 + IDLE_S, MOST) == falls_to(name, other)


def test_what_a_worker_at_its_limit_leaves_is_served_by_another() -> None:
    full, other = shares("a"), shares("b", "a")
    served = full.plan(0, 3)
    for camera in set(CAMERAS) - served:
        other.taken(Serves("detector", "a", camera), alive=False)
    other.plan(1, MOST)
    assert other.plan(1 + IDLE_S, MOST) >= set(CAMERAS) - served - falls_to("b", "a")


def test_one_that_is_idle_for_a_robot_of_its_own_leaves_it_to_those_for_any() -> None:
    made = shares("a")
    made.worker(WorkerAlive("detector", "own", robot="r1"), alive=True)
    assert made.plan(1, MOST) == made.plan(1 + IDLE_S, MOST) == set(CAMERAS)


@pytest.mark.parametrize(("limit", "kept"), [("MAX_TAKEN", -1), ("MAX_STREAMS", 0)])
def test_where_more_was_taken_over_than_is_remembered_a_camera_is_served_twice_rather_than_not_at_all(
    limit: str, kept: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(camera_assignment, limit, 1)
    made = shares("a")
    made.worker(token("b"), alive=True)
    of_b = sorted(falls_to("b", "a"))
    serve_all(made, "b", of_b)
    made.plan(1, MOST)
    assert made.plan(1 + IDLE_S, MOST) == set(CAMERAS) - {of_b[kept]}


@pytest.mark.parametrize("names", [2, 200])
def test_a_flood_of_tokens_for_cameras_taken_over_takes_no_others_place(
    names: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_b = falls_to("b", "a")
    monkeypatch.setattr(camera_assignment, "MAX_TAKEN", 30)
    monkeypatch.setattr(camera_assignment, "MAX_STREAMS", 15)
    made = shares("a")
    made.worker(token("b"), alive=True)
    flood = [(f"invented{number % names}", CameraKey("r9", f"c{number}")) for number in range(200)]
    for name, camera in flood[:100]:
        made.taken(Serves("detector", name, camera), alive=True)
    serve_all(made, "b", of_b)
    for name, camera in flood[100:]:
        made.taken(Serves("detector", name, camera), alive=True)
    made.plan(1, MOST)
    assert made.plan(1 + IDLE_S, MOST) == falls_to("a", "b")
    for name, camera in flood:
        made.taken(Serves("detector", name, camera), alive=False)
    assert made.plan(2 + IDLE_S, MOST) == falls_to("a", "b")


def test_a_worker_serves_however_many_are_said_to_be_there_before_it() -> None:
    made = OwnCameras("a")
    for camera in CAMERAS:
        made.camera(camera, alive=True)
    for number in range(camera_assignment.MAX_WORKERS):
        made.worker(WorkerAlive("detector", f"idle{number}", weight=1000), alive=True)
    made.worker(token("a"), alive=True)
    made.plan(1, MOST)
    assert made.plan(1 + IDLE_S, MOST) == set(CAMERAS)


def test_workers_that_start_beside_many_that_serve_nothing_share_the_cameras_once_they_show_what_they_serve() -> None:
    crew = {name: OwnCameras(name) for name in "ab"}
    for made in crew.values():
        for camera in CAMERAS:
            made.camera(camera, alive=True)
        for number in range(200):
            made.worker(WorkerAlive("detector", f"idle{number}", weight=1000), alive=True)
        for name in "ab":
            made.worker(token(name), alive=True)
        made.plan(1, MOST)
    plans = {name: made.plan(1 + IDLE_S, MOST) for name, made in crew.items()}
    assert plans == {"a": set(CAMERAS), "b": set(CAMERAS)}, "nobody knows yet that the other one serves"
    for name, other in ("ab", "ba"):
        serve_all(crew[name], other, plans[other])
    assert crew["a"].plan(2 + IDLE_S, MOST) == falls_to("a", "b")
    assert crew["b"].plan(2 + IDLE_S, MOST) == falls_to("b", "a")


def test_a_robot_of_many_cameras_keeps_no_others_from_being_served(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_cameras, "MOST_CAMERAS", 5)
    made = OwnCameras("a")
    made.worker(token("a"), alive=True)
    flood = [CameraKey("r9", f"c{number}") for number in range(6)]
    assert [made.camera(camera, alive=True) for camera in flood] == [True] * 5 + [False]
    others = [CameraKey("r1", "c0"), CameraKey("r2", "c0")]
    assert [made.camera(camera, alive=True) for camera in others] == [True, True]
    assert made.plan(1, 4) == {*flood[:2], *others}
    assert made.camera(flood[0], alive=False)
    assert made.camera(flood[5], alive=True)


def test_another_than_the_one_it_falls_to_cannot_take_it_over() -> None:
    made = shares("a", "c")
    made.worker(token("b"), alive=True)
    serve_all(made, "c")
    assert made.plan(1, MOST) == falls_to("a", "c")


def test_one_that_dies_before_it_took_over_leaves_no_gap() -> None:
    made = shares("a")
    made.worker(token("b"), alive=True)
    made.plan(1, MOST)
    made.worker(token("b"), alive=False)
    assert made.plan(2, MOST) == set(CAMERAS)


def test_one_that_leaves_goes_on_until_others_have_taken_over() -> None:
    made = shares("a", "b")
    mine = falls_to("a", "b")
    made.worker(token("a"), alive=False)
    assert made.plan(1, MOST) == mine
    assert made.handing_over
    serve_all(made, "b", mine)
    assert made.plan(1, MOST) == frozenset()


def test_the_last_one_that_leaves_has_nobody_to_wait_for() -> None:
    made = shares("a")
    made.worker(token("a"), alive=False)
    assert made.plan(1, MOST) == frozenset()
    assert not made.handing_over


def test_one_that_was_taken_for_dead_gets_its_cameras_back_and_the_others_let_go() -> None:
    made = shares("a", "b")
    made.worker(token("b"), alive=False)
    assert made.plan(1, MOST) == set(CAMERAS)
    made.worker(token("b"), alive=True)
    for camera in falls_to("b", "a"):
        made.taken(Serves("detector", "b", camera), alive=True)
    assert made.plan(2, MOST) == falls_to("a", "b")


def test_a_camera_that_is_gone_is_let_go_at_once() -> None:
    made = shares("a")
    made.worker(token("b"), alive=True)
    made.plan(1, MOST)
    for camera in CAMERAS:
        made.camera(camera, alive=False)
    assert made.plan(1, MOST) == frozenset()


def test_no_more_than_it_may_and_of_each_robot_as_many() -> None:
    made = shares("a")
    assert made.plan(0, 3) == {CAMERAS[0], CAMERAS[4], CAMERAS[8]}
    assert made.plan(0, 6) == {*CAMERAS[0:2], *CAMERAS[4:6], CAMERAS[8], CAMERAS[12]}


def test_news_is_what_was_not_known() -> None:
    made = OwnCameras("a")
    taken = Serves("detector", "b", CAMERAS[0])
    assert [made.worker(token("b"), alive=alive) for alive in (False, True, True, False)] == [
        False,
        True,
        True - 1,
        True,
    ]
    assert [made.camera(CAMERAS[0], alive=alive) for alive in (False, True, True, False)] == [False, True, False, True]
    assert [made.taken(taken, alive=alive) for alive in (False, True, True, False)] == [False, True, False, True]


def test_what_is_known_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, name in (
        (camera_assignment, "MAX_WORKERS"),
        (own_cameras, "MAX_CAMERAS"),
        (camera_assignment, "MAX_TAKEN"),
    ):
        monkeypatch.setattr(module, name, 2)
    made = OwnCameras("a")
    assert [made.worker(token(name), alive=True) for name in "bcda"] == [True, True, False, True]
    assert [made.camera(camera, alive=True) for camera in CAMERAS[:3]] == [True, True, False]
    tokens = [Serves("detector", name, CAMERAS[0]) for name in "abc"]
    assert [made.taken(each, alive=True) for each in tokens] == [True, True, True]
    assert [made.taken(each, alive=False) for each in tokens] == [False, True, True]


@given(st.lists(st.tuples(st.sampled_from("abcd"), st.booleans()), max_size=12))
def test_once_all_have_heard_everything_each_camera_is_looked_after_once(changes: list[tuple[str, bool]]) -> None:
    alive = {"e"}
    crew = {name: shares(name, "e") if name == "e" else shares(name) for name in "abcde"}
    for name, comes in changes:
        (alive.add if comes else alive.discard)(name)
    for member in crew.values():
        for name in "abcde":
            member.worker(token(name), alive=name in alive)
    for name in alive:
        for other in alive - {name}:
            serve_all(crew[name], other)
    plans = [crew[name].plan(IDLE_S, MOST) for name in alive]
    assert sorted(camera for plan in plans for camera in plan) == sorted(CAMERAS)


tokens = st.builds(
    WorkerAlive,
    st.just("detector"),
    st.sampled_from("abc"),
    st.sampled_from([0.5, 1.0, 8.0]),
    st.sampled_from([None, "r0", "r1"]),
)
turns = st.one_of(st.tuples(tokens, st.booleans()), st.tuples(st.sampled_from(CAMERAS), st.booleans()))


@given(st.lists(turns, max_size=30))
def test_who_was_there_all_along_knows_no_other_owners_than_who_comes_now(
    news: list[tuple[WorkerAlive | CameraKey, bool]],
) -> None:
    made, workers, cameras = OwnCameras("a"), set[WorkerAlive](), set[CameraKey]()
    for name in "bc":
        serve_all(made, name)
    for now_s, (member, alive) in enumerate(news):
        if isinstance(member, CameraKey):
            made.camera(member, alive=alive)
            (cameras.add if alive else cameras.discard)(member)
        else:
            made.worker(member, alive=alive)
            (workers.add if alive else workers.discard)(member)
        assert made.plan(now_s, MOST) == {camera for camera in cameras if owner(camera, workers) == "a"}
