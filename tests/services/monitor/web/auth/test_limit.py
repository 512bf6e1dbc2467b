from collections.abc import Callable

import pytest

from services.monitor.web.auth.passwords import (
    MAX_KEYS,
    MAX_NAME,
    MAX_OF_ADDRESS,
    MAX_OF_NAME,
    WINDOW_S,
    FailureLimit,
    network_of,
)


def test_so_many_failures_of_a_name_from_an_address_and_then_a_wait() -> None:
    limit = FailureLimit()
    for second in range(MAX_OF_NAME):
        assert limit.wait_s("a", "eve", second) == 0
        limit.failed("a", "eve", second)
    assert limit.wait_s("a", "eve", MAX_OF_NAME) == WINDOW_S - MAX_OF_NAME
    assert (limit.wait_s("a", "bob", 5), limit.wait_s("b", "eve", 5)) == (0, 0)
    assert limit.wait_s("a", "eve", WINDOW_S) == 0


def test_so_many_of_an_address_whatever_the_names() -> None:
    limit = FailureLimit()
    for number in range(MAX_OF_ADDRESS):
        limit.failed("a", str(number), 0)
    assert limit.wait_s("a", "new", 1) == WINDOW_S - 1


@pytest.mark.parametrize("outcome", [FailureLimit.succeeded, FailureLimit.unknown])
def test_who_succeeds_or_was_not_looked_at_is_not_held_back(outcome: Callable[[FailureLimit, str, str], None]) -> None:
    limit = FailureLimit()
    for _ in range(2 * MAX_OF_ADDRESS):
        limit.failed("a", "eve", 0)
        outcome(limit, "a", "eve")
    assert limit.wait_s("a", "eve", 0) == 0
    for _ in range(MAX_OF_NAME):
        limit.failed("a", "eve", 0)
    assert limit.wait_s("a", "eve", 0) > 0


def test_of_a_name_only_its_beginning_is_remembered() -> None:
    limit = FailureLimit()
    limit.failed("a", "e" * 60_000, 0)
    assert max(len(part) for key in limit._failures for part in key) == MAX_NAME


def test_it_remembers_so_much_and_no_more() -> None:
    limit = FailureLimit()
    for number in range(MAX_KEYS):
        limit.failed(str(number), "eve", 0)
    assert len(limit._failures) == MAX_KEYS


def test_an_address_counts_for_whoever_has_it() -> None:
    assert network_of("10.1.2.3") == "10.1.2.3"
    assert network_of("::ffff:10.1.2.3") == "10.1.2.3"
    assert network_of("2001:db8:1:2:3::4") == network_of("2001:db8:1:2::") == "2001:db8:1:2::/64"
    assert network_of("x" * 100) == "x" * 64
