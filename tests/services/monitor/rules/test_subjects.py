"""Conditions that wait for their alert to be due."""

import random

from services.monitor.rules.subjects import SLACK, PendingSubjects, SubjectKey

A: SubjectKey = ("r1", "front", "box", "")
B: SubjectKey = ("r2", "front", "box", "")


def ripe(waiting: PendingSubjects) -> dict[str, list[SubjectKey]]:
    return {rule: list(places) for rule, places in waiting.ripe.items()}


def test_a_place_is_ripe_once_its_time_has_come_and_until_it_is_discarded() -> None:
    waiting = PendingSubjects()
    waiting.add("late", A, 20)
    waiting.add("soon", A, 10)
    assert waiting.next_ns() == 10
    waiting.ripen(10)
    assert (ripe(waiting), waiting.next_ns()) == ({"soon": [A]}, 20)
    waiting.ripen(30)
    assert (ripe(waiting), waiting.next_ns()) == ({"soon": [A], "late": [A]}, None)
    waiting.discard("soon", A)
    assert ripe(waiting) == {"late": [A]}


def test_what_was_discarded_is_never_ripe_and_may_wait_again() -> None:
    waiting = PendingSubjects()
    waiting.add("rule", A, 10)
    waiting.discard("rule", A)
    assert waiting.next_ns() is None
    waiting.add("rule", A, 20)
    waiting.ripen(10)
    assert (ripe(waiting), waiting.next_ns()) == ({}, 20)
    waiting.discard("rule", B)


def test_places_of_rules_that_are_gone_are_forgotten() -> None:
    waiting = PendingSubjects()
    for rule in ("stays", "goes"):
        waiting.add(rule, A, 10)
        waiting.add(rule, B, 20)
    waiting.ripen(10)
    waiting.keep({"stays"})
    waiting.ripen(20)
    assert ripe(waiting) == {"stays": [A, B]}


def test_what_comes_and_goes_for_ever_takes_no_more_room() -> None:
    waiting = PendingSubjects()
    for moment in range(10_000):
        waiting.add("rule", A, 1_000_000 + moment)
        waiting.discard("rule", A)
    assert len(waiting._queue) <= SLACK + 1


def test_it_is_as_looking_through_everything_would_be() -> None:
    rng, waiting = random.Random(1), PendingSubjects()  # noqa: S311 - no secrets
    plain: dict[tuple[str, SubjectKey], int] = {}
    for now in range(2_000):
        key = (rng.choice("ab"), rng.choice([A, B, ("r3", "", "", "")]))
        if key in plain and rng.random() < 0.7:
            del plain[key]
            waiting.discard(*key)
        elif key not in plain:
            plain[key] = now + rng.randrange(-3, 40)
            waiting.add(*key, plain[key])
        waiting.ripen(now)
        due = {key for key, due_ns in plain.items() if due_ns <= now}
        assert {(rule, place) for rule, places in waiting.ripe.items() for place in places} == due
        assert waiting.next_ns() == min((due_ns for due_ns in plain.values() if due_ns > now), default=None)
