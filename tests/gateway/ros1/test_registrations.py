from __future__ import annotations

import pytest

from gateway.ros1.master import SystemState
from gateway.ros1.registrations import Changes, Registration, Registrations, Role

CHAT = Registration(Role.PUBLISHER, "/chat", "std_msgs/String")
COLOR = Registration(Role.SUBSCRIBER, "/color", "sensor_msgs/Image")
NOTHING = Changes((), ())


def registered(*registrations: Registration) -> Registrations:
    book = Registrations("/ours")
    for registration in registrations:
        book.want(registration)
        book.registering(registration)
        book.registered(registration)
    return book


def state(publishers: dict[str, tuple[str, ...]], subscribers: dict[str, tuple[str, ...]]) -> SystemState:
    return SystemState(publishers, subscribers, {})


def test_wanted_is_registered_once() -> None:
    book = Registrations("/ours")
    book.want(CHAT)
    assert book.plan() == Changes((), (CHAT,))
    book.registering(CHAT)
    assert book.plan() == Changes((), (CHAT,))
    book.registered(CHAT)
    assert book.plan() == NOTHING


def test_released_is_unregistered_once() -> None:
    book = registered(CHAT)
    book.wanted.discard(CHAT)
    assert book.plan() == Changes((CHAT,), ())
    book.unregistered(CHAT)
    assert book.plan() == NOTHING


def test_registering_that_may_have_arrived_is_unregistered() -> None:
    book = Registrations("/ours")
    book.registering(CHAT)
    assert book.plan() == Changes((CHAT,), ())


def test_type_that_replaced_another_at_the_master_is_not_unregistered_with_it() -> None:
    changed = Registration(COLOR.role, COLOR.topic, "sensor_msgs/CompressedImage")
    book = registered(COLOR, CHAT)
    book.wanted.discard(COLOR)
    book.want(changed)
    assert book.plan() == Changes((COLOR,), (changed,))
    # The master refused to unregister: it goes by topic and node, so asked once more it would forget the new one.
    book.registering(changed)
    book.registered(changed)
    assert book.plan() == NOTHING
    book.wanted.clear()
    assert set(book.plan().unregister) == {changed, CHAT}


def test_what_was_never_tried_is_not_unregistered() -> None:
    book = Registrations("/ours")
    book.want(CHAT)
    book.wanted.discard(CHAT)
    assert book.plan() == NOTHING


def test_wanted_again_while_it_was_unregistered() -> None:
    book = registered(CHAT)
    book.unregistered(CHAT)
    assert book.plan() == Changes((), (CHAT,))


def test_wanted_again_before_it_was_unregistered_asks_again_who_is_there() -> None:
    book = registered(COLOR)
    book.wanted.discard(COLOR)
    book.want(COLOR)
    assert book.plan() == Changes((), (COLOR,))


def test_wanted_again_while_it_was_registered_asks_again_who_is_there() -> None:
    book = Registrations("/ours")
    book.want(COLOR)
    book.registering(COLOR)
    book.wanted.discard(COLOR)
    book.want(COLOR)
    book.registered(COLOR)
    assert book.plan() == Changes((), (COLOR,))
    book.registering(COLOR)
    book.registered(COLOR)
    assert book.plan() == NOTHING


def test_restarted_master_has_forgotten_us() -> None:
    book = registered(CHAT, COLOR)
    assert book.compare(state({}, {}), {}) is True
    assert book.compare(state({}, {}), {}) is False
    assert set(book.plan().register) == {CHAT, COLOR}


def test_confirmed_is_left_alone() -> None:
    book = registered(CHAT, COLOR)
    told = state({"/chat": ("/ours",), "/color": ("/cam",)}, {"/color": ("/ours",)})
    assert book.compare(told, {"/color": [True]}) is False
    assert book.plan() == NOTHING


@pytest.mark.parametrize(
    ("listed", "links"),
    [
        pytest.param(("/cam", "/cam2"), [True], id="one more"),
        pytest.param(("/cam",), [True, True], id="one less"),
        pytest.param(("/cam",), [False], id="perhaps another in its place"),
        pytest.param(("/cam", "/cam2"), [True, False], id="perhaps another beside one that is connected"),
    ],
)
def test_update_about_publishers_that_may_be_lost_registers_the_subscription_again(
    listed: tuple[str, ...], links: list[bool]
) -> None:
    book = registered(COLOR)
    book.compare(state({"/color": listed}, {"/color": ("/ours",)}), {"/color": links})
    assert book.plan() == Changes((), (COLOR,))


def test_now_and_then_a_subscription_is_registered_again_though_all_looks_well() -> None:
    book = registered(CHAT, COLOR)
    told = state({"/chat": ("/ours",), "/color": ("/cam",)}, {"/color": ("/ours",)})
    book.compare(told, {"/color": [True]}, renew=True)
    assert book.plan() == Changes((), (COLOR,))


def test_master_that_has_forgotten_one_of_ours_is_still_the_same() -> None:
    book = registered(CHAT, COLOR)
    assert book.compare(state({"/chat": ("/ours",)}, {}), {}) is False
    assert book.plan() == Changes((), (COLOR,))


def test_only_the_own_role_counts() -> None:
    book = registered(CHAT)
    book.compare(state({"/chat": ("/other",)}, {"/chat": ("/ours",)}), {})
    assert book.plan() == Changes((), (CHAT,))
