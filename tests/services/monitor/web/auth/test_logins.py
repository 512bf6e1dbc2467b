import asyncio
from pathlib import Path

import pytest

from services.monitor.web.auth.logins import Access, AccessError
from services.monitor.web.auth.passwords import MAX_OF_NAME
from services.monitor.web.auth.store import UserStore
from services.monitor.web.auth.users import MAX_LOGINS, Kind, Role
from tests.services.monitor.web.serving import PASSWORD, access_in, token_of, users_in

HOUR_NS = 3_600 * 10**9


class Clock:
    def __init__(self) -> None:
        self.ns = 10**18

    def __call__(self) -> int:
        return self.ns


def access_to(folder: Path, clock: Clock | None = None) -> Access:
    return Access(UserStore(users_in(folder)), 1, "http://monitor.test", clock or Clock())


async def test_who_has_the_link_makes_the_first_user_and_nobody_the_second(tmp_path: Path) -> None:
    access = access_to(tmp_path)
    assert (access.needs_setup, access.invitation) == (False, "")
    await access.look()
    assert access.needs_setup
    secret = access.invitation.removeprefix("http://monitor.test/setup?token=")
    for wrong in ("", "x", secret + "x", "\ud800"):
        with pytest.raises(AccessError, match="invalid set-up link"):
            await access.set_up(wrong, "ann", PASSWORD, "a")
    with pytest.raises(AccessError, match="10 to 256"):
        await access.set_up(secret, "ann", "short", "b")
    with pytest.raises(AccessError, match="user's name"):
        await access.set_up(secret, "<b>", PASSWORD, "b")
    session = await access.set_up(secret, "ann", PASSWORD, "b")
    visitor = access.visitor(session, Kind.SESSION)
    assert visitor is not None
    assert (visitor.name, visitor.role, visitor.may_act) == ("ann", Role.OPERATOR, True)
    assert (access.needs_setup, access.invitation) == (False, "")
    with pytest.raises(AccessError, match="invalid set-up link"):
        await access.set_up(secret, "bob", PASSWORD, "c")


async def test_of_two_monitors_one_makes_the_first_user(tmp_path: Path) -> None:
    one, other = access_to(tmp_path), access_to(tmp_path)
    await one.look()
    await other.look()
    await one.set_up(one.invitation.split("=")[1], "ann", PASSWORD, "a")
    with pytest.raises(AccessError, match="made already"):
        await other.set_up(other.invitation.split("=")[1], "bob", PASSWORD, "a")


async def test_a_session_is_kept_over_a_restart_and_ends_when_it_is_not_used(tmp_path: Path) -> None:
    clock = Clock()
    await access_in(tmp_path)
    before = access_to(tmp_path, clock)
    session = await before.log_in("viewer", PASSWORD, "a")
    await before.look()
    access = access_to(tmp_path, clock)
    assert access.visitor(session, Kind.SESSION) is None
    await access.look()
    visitor = access.visitor(session, Kind.SESSION)
    assert visitor is not None
    for _ in range(3):  # each use moves its end
        clock.ns += HOUR_NS * 2 // 3
        await access.look()
        assert access.visitor(session, Kind.SESSION) is not None
        await access.look()
    clock.ns += HOUR_NS
    assert (visitor.may_look, access.visitor(session, Kind.SESSION)) == (False, None)


async def test_a_screen_that_is_looked_at_stays_until_its_session_is_ended(tmp_path: Path) -> None:
    clock = Clock()
    await access_in(tmp_path)
    access = access_to(tmp_path, clock)
    session = await access.log_in("viewer", PASSWORD, "a")
    visitor = access.visitor(session, Kind.SESSION)
    assert visitor is not None
    for _ in range(3):
        clock.ns += HOUR_NS * 2 // 3
        visitor.stay()
        await access.look()
        assert visitor.may_look
    access.log_out(session)
    visitor.stay()
    assert not visitor.may_look


async def test_who_logs_out_is_out_everywhere_at_once(tmp_path: Path) -> None:
    access, other = await access_in(tmp_path), await access_in(tmp_path)
    session = await access.log_in("operator", PASSWORD, "a")
    stays = await access.log_in("operator", PASSWORD, "a")
    await access.look()
    await other.look()
    visitor = access.visitor(session, Kind.SESSION)
    access.log_out(session)
    access.log_out("nobody's")
    assert visitor is not None
    assert not visitor.may_look
    await access.look()
    await other.look()
    assert other.visitor(session, Kind.SESSION) is None
    assert other.visitor(stays, Kind.SESSION) is not None


async def test_wrong_passwords_and_unknown_names_are_the_same_and_limited(tmp_path: Path) -> None:
    access = await access_in(tmp_path)
    for name in ("operator", "nobody", "\ud800"):
        with pytest.raises(AccessError, match=r"^wrong name or password$"):
            await access.log_in(name, "wrong", "a")
    for _ in range(MAX_OF_NAME - 1):
        with pytest.raises(AccessError, match="wrong name or password"):
            await access.log_in("operator", "wrong", "a")
    with pytest.raises(AccessError, match="too many failed attempts") as refused:
        await access.log_in("operator", PASSWORD, "a")
    assert refused.value.wait_s > 0
    assert await access.log_in("operator", PASSWORD, "b")


async def test_many_at_once_are_no_way_around_the_limit(tmp_path: Path) -> None:
    access = await access_in(tmp_path)
    tried = await asyncio.gather(
        *(access.log_in("operator", "wrong", "a") for _ in range(3 * MAX_OF_NAME)), return_exceptions=True
    )
    assert sum("wrong name or password" in str(each) for each in tried) == MAX_OF_NAME


async def test_a_changed_or_removed_user_is_out_at_the_next_look(tmp_path: Path) -> None:
    access, store = await access_in(tmp_path), UserStore(users_in(tmp_path))
    session, token = await access.log_in("operator", PASSWORD, "a"), await token_of(access, tmp_path, "operator")
    await access.look()
    visitors = [access.visitor(session, Kind.SESSION), access.visitor(token, Kind.TOKEN)]
    assert [each is not None and each.may_act for each in visitors] == [True, True]
    (user,) = [user for user in await store.users() if user.name == "operator"]
    await store.remove("operator")
    await store.add(type(user)("operator", Role.OPERATOR, user.password, 2))
    await access.look()
    assert [each is not None and each.may_look for each in visitors] == [False, False]


async def test_a_database_that_is_gone_locks_nobody_out(tmp_path: Path) -> None:
    access = await access_in(tmp_path)
    session = await access.log_in("operator", PASSWORD, "a")
    await access.look()
    file, away = tmp_path / "users.db", tmp_path / "away.db"
    file.rename(away)
    file.mkdir()
    await access.look()
    assert access.problem.startswith("the users cannot be read: ")
    assert access.visitor(session, Kind.SESSION) is not None
    late = await access.log_in("viewer", PASSWORD, "a")
    await access.look()
    assert access.problem.startswith("log-ins are not being saved: ")
    file.rmdir()
    away.rename(file)
    await access.look()
    assert access.problem == ""
    again = await access_in(tmp_path)
    assert again.visitor(late, Kind.SESSION) is not None


async def test_nobody_is_let_in_while_the_users_are_not_known(tmp_path: Path) -> None:
    (tmp_path / "users.db").mkdir()
    access = access_to(tmp_path)
    with pytest.raises(AccessError, match="the users cannot be read"):
        await access.log_in("operator", PASSWORD, "a")
    assert not access.needs_setup
    with pytest.raises(AccessError, match="cannot be saved"):
        await access.set_up(access._setup_secret, "ann", PASSWORD, "a")


async def test_a_user_has_so_many_sessions_and_no_more(tmp_path: Path) -> None:
    clock = Clock()
    await access_in(tmp_path)
    access = access_to(tmp_path, clock)
    await access.look()
    user = (await UserStore(users_in(tmp_path)).users())[0]
    sessions = []
    for _ in range(MAX_LOGINS + 1):
        clock.ns += 1
        sessions.append(access._open(user))
    good = [access.visitor(session, Kind.SESSION) is not None for session in sessions]
    assert good == [False] + [True] * MAX_LOGINS


async def test_the_file_is_nobody_elses_to_read(tmp_path: Path) -> None:
    await access_in(tmp_path)
    assert (tmp_path / "users.db").stat().st_mode & 0o777 == 0o600
