import pytest

from services.monitor.duplicate_gateways import KNOWN_ACCOUNTS, MOST_PROCESSES, DuplicateGateways


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
