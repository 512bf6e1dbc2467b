"""Passwords, and the limit of wrong ones."""

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest

from services.monitor.web.auth.logins import AccessError
from services.monitor.web.auth.passwords import (
    MAX_KEYS,
    MAX_LENGTH,
    MAX_NAME,
    MAX_OF_ADDRESS,
    MAX_OF_NAME,
    MAX_WAITING,
    MIN_LENGTH,
    WINDOW_S,
    BusyError,
    FailureLimit,
    Passwords,
    mistake_in,
    network_of,
)
from tests.services.monitor.web.serving import PASSWORD, access_in


async def test_a_password_is_kept_as_an_argon2id_hash_with_a_salt_of_its_own() -> None:
    passwords = Passwords()
    one, other = await passwords.hash(PASSWORD), await passwords.hash(PASSWORD)
    assert one.startswith("$argon2id$")
    assert one != other
    assert await passwords.check(one, PASSWORD)
    assert await passwords.check(other, PASSWORD)
    assert not await passwords.check(one, PASSWORD + "x")
    for nobodys in (None, "", "no hash"):
        assert not await passwords.check(nobodys, PASSWORD)
        assert not await passwords.check(nobodys, "")


def kept_in(folder: Path) -> bytes:
    return b"".join([file.read_bytes() for file in folder.iterdir()])


async def test_neither_passwords_nor_what_shows_that_one_is_logged_in_are_in_the_database(tmp_path: Path) -> None:
    access = await access_in(tmp_path)
    session = await access.log_in("viewer", PASSWORD, "here")
    await access.look()
    kept = kept_in(tmp_path)
    assert b"$argon2id$" in kept
    assert b"viewer" in kept
    assert PASSWORD.encode() not in kept
    assert session.encode() not in kept


async def test_whoever_is_turned_away_because_many_log_in_may_try_again(tmp_path: Path) -> None:
    access = await access_in(tmp_path)
    many = [asyncio.create_task(access._passwords.check(None, "x")) for _ in range(MAX_WAITING)]
    await asyncio.sleep(0)
    for _ in range(MAX_OF_NAME + 1):
        with pytest.raises(AccessError, match="too many people"):
            await access.log_in("viewer", PASSWORD, "here")
    for each in many:
        each.cancel()
    await asyncio.wait(many)
    assert await access.log_in("viewer", PASSWORD, "here")


async def test_too_many_at_once_are_refused() -> None:
    passwords = Passwords()
    many = [asyncio.create_task(passwords.check(None, "x")) for _ in range(MAX_WAITING)]
    await asyncio.sleep(0)
    with pytest.raises(BusyError, match="too many people"):
        await passwords.hash(PASSWORD)
    for each in many:
        each.cancel()
    await asyncio.wait(many)
    assert await passwords.hash(PASSWORD)


@pytest.mark.parametrize(
    ("password", "mistake"),
    [
        ("a1b2c3d4e", f"{MIN_LENGTH} to {MAX_LENGTH} characters"),
        ("a1b2c3d4e5", ""),
        ("abcde" * 60, f"{MIN_LENGTH} to {MAX_LENGTH} characters"),
        ("aabbccdddd", "5 different"),
        ("aabbccddee", ""),
        ("a1b2c3d4e5\udcff", "UTF-8"),
    ],
)
def test_what_makes_a_password(password: str, mistake: str) -> None:
    assert mistake in mistake_in(password)
    assert bool(mistake) == bool(mistake_in(password))


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
