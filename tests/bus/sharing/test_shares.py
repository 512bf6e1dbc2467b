"""What one worker looks after, as others come and go."""

from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.sharing import rendezvous as limits
from bus.sharing.rendezvous import HAND_OVER_S, Shares, owner
from schemas.keys import CameraKey
from schemas.worker_keys import Serves, WorkerAlive

CAMERAS = [CameraKey(f"r{robot}", f"c{camera}") for robot in range(4) for camera in range(4)]
MOST = 1000


def token(name: str) -> WorkerAlive:
    return WorkerAlive("detector", name)


def falls_to(name: str, *others: str) -> set[CameraKey]:
    crew = {token(each) for each in (name, *others)}
    return {camera for camera in CAMERAS if owner(camera, crew) == name}


def shares(name: str, *others: str, cameras: Iterable[CameraKey] = CAMERAS) -> Shares:
    made = Shares(name)
    for camera in cameras:
        made.camera(camera, alive=True)
    for each in (name, *others):
        made.worker(token(each), alive=True)
    made.plan(0, MOST)
    return made


def test_what_falls_to_it_and_no_more() -> None:
    assert shares("a").serving == set(CAMERAS)
    assert shares("a", "b").serving == falls_to("a", "b")
    assert Shares("a").plan(0, MOST) == frozenset()


def test_what_falls_to_another_stays_until_that_one_has_taken_it_over() -> None:
    made = shares("a")
    made.worker(token("b"), alive=True)
    assert made.plan(1, MOST) == set(CAMERAS)
    assert made.next_s == 1 + HAND_OVER_S
    first, *rest = sorted(falls_to("b", "a"))
    assert made.taken(Serves("detector", "b", first), alive=True)
    assert made.plan(1.1, MOST) == set(CAMERAS) - {first}
    for camera in rest:
        made.taken(Serves("detector", "b", camera), alive=True)
    assert made.plan(1.2, MOST) == falls_to("a", "b")
    assert made.next_s is None


def test_it_stays_no_longer_than_the_time_to_hand_over() -> None:
    made = shares("a")
    made.worker(token("b"), alive=True)
    made.plan(1, MOST)
    assert made.plan(0.999 + HAND_OVER_S, MOST) == set(CAMERAS)
    assert made.plan(1 + HAND_OVER_S, MOST) == falls_to("a", "b")
    assert not made.handing_over


def test_another_than_the_one_it_falls_to_cannot_take_it_over() -> None:
    made = shares("a", "c")
    made.worker(token("b"), alive=True)
    for camera in CAMERAS:
        made.taken(Serves("detector", "c", camera), alive=True)
    assert made.plan(1, MOST) == falls_to("a", "c")


def test_one_that_dies_before_it_took_over_leaves_no_gap() -> None:
    made = shares("a")
    made.worker(token("b"), alive=True)
    made.plan(1, MOST)
    made.worker(token("b"), alive=False)
    assert made.plan(1 + HAND_OVER_S, MOST) == set(CAMERAS)


def test_one_that_leaves_goes_on_until_others_have_taken_over() -> None:
    made = shares("a", "b")
    mine = falls_to("a", "b")
    made.worker(token("a"), alive=False)
    assert made.plan(1, MOST) == mine
    assert made.handing_over
    for camera in mine:
        made.taken(Serves("detector", "b", camera), alive=True)
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


def test_no_more_than_it_may() -> None:
    made = shares("a")
    assert made.plan(0, 3) == set(CAMERAS[:3])


def test_news_is_what_was_not_known() -> None:
    made = Shares("a")
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
    for name in ("MAX_WORKERS", "MAX_CAMERAS", "MAX_TAKEN"):
        monkeypatch.setattr(limits, name, 2)
    made = Shares("a")
    assert [made.worker(token(name), alive=True) for name in "abc"] == [True, True, False]
    assert [made.camera(camera, alive=True) for camera in CAMERAS[:3]] == [True, True, False]
    tokens = [Serves("detector", name, CAMERAS[0]) for name in "abc"]
    assert [made.taken(each, alive=True) for each in tokens] == [True, True, False]
    made.taken(tokens[0], alive=False)
    assert made.taken(Serves("detector", "a", CAMERAS[1]), alive=True)


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
        crew[name].plan(0, MOST)
    plans = [crew[name].plan(HAND_OVER_S, MOST) for name in alive]
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
    made, workers, cameras = Shares("a"), set[WorkerAlive](), set[CameraKey]()
    for now_s, (member, alive) in enumerate(news):
        if isinstance(member, CameraKey):
            made.camera(member, alive=alive)
            (cameras.add if alive else cameras.discard)(member)
        else:
            made.worker(member, alive=alive)
            (workers.add if alive else workers.discard)(member)
        made.plan(now_s * HAND_OVER_S, MOST)
        assert made.plan((now_s + 1) * HAND_OVER_S, MOST) == {
            camera for camera in cameras if owner(camera, workers) == "a"
        }
