import msgspec
import pytest

from services.monitor.duplicate_gateways import (
    KNOWN_ACCOUNTS,
    MOST_PROCESSES,
    SHOWN_NS,
    DuplicateGateways,
    RivalSenders,
)
from tests.services.monitor.sightings import FRONT, S, seen


def heard(processes: str) -> bool:
    duplicates = DuplicateGateways()
    for boot_id in processes:
        duplicates.take("r1", boot_id)
    assert not duplicates.has("r2")
    return duplicates.has("r1")


@pytest.mark.parametrize("processes", ["", "a", "aab", "aabbcc", "abcdefghijklmnopqrstuvwxyz"])
def test_a_gateway_that_is_restarted_is_no_namesake(processes: str) -> None:
    assert not heard(processes)


@pytest.mark.parametrize("number", [2, 3, MOST_PROCESSES])
def test_those_that_are_heard_in_turns_are(number: int) -> None:
    processes = "abcdefghijklmnopqrstuvwxyz"[:number]
    assert not heard(processes)
    assert heard(processes + "a")
    assert heard(2 * processes)


def test_they_are_no_more_when_one_alone_goes_on_whether_it_is_restarted_or_not() -> None:
    assert heard("aba" + (KNOWN_ACCOUNTS - 1) * "a")
    assert not heard("aba" + KNOWN_ACCOUNTS * "a")
    assert not heard("abacdefgh")


def by_turns(seconds: float, *workers: str, model: str = "m") -> RivalSenders:
    """Return what knows of ten lists a second of one camera, by workers in turn."""
    rivals = RivalSenders()
    for number in range(round(seconds * 10)):
        worker = workers[number % len(workers)]
        rivals.take(FRONT, msgspec.structs.replace(seen(number), worker=worker, model=model), number * S // 10)
    return rivals


def test_two_workers_that_send_a_cameras_lists_by_turns_for_long_are_found_and_a_takeover_is_not() -> None:
    assert by_turns(9, "a", "b").found(9 * S) == {}
    assert by_turns(30, "a").found(30 * S) == {}
    rivals = by_turns(12, "a", "b")
    assert rivals.found(12 * S) == {FRONT: ("a", "b")}
    assert rivals.found(12 * S + 2 * SHOWN_NS) == {}
    rivals.forget(FRONT)
    assert rivals.found(12 * S) == {}


def test_takeovers_one_after_the_other_are_none() -> None:
    rivals = RivalSenders()
    for minute in range(10):
        rivals.take(FRONT, msgspec.structs.replace(seen(minute), worker="ab"[minute % 2]), minute * 60 * S)
    assert rivals.found(600 * S) == {}
