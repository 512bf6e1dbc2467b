"""Lists of presence tokens: their form, and real sessions that show and read them."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
import zenoh

from bus import QUEUE, BusSettings, Presence, QoS, Watch, open_bus
from bus.presence import listed_tokens, token_lists
from bus.presence.token_lists import MOST_CHARACTERS, FollowedTokens, can_list, list_keys, listed_keys, lists_of
from tests.bus.sessions import client, router
from tests.contract.conftest import free_endpoint
from tests.waiting import next_of, until

PREFIX = "fleet/r1"
KEYS = ["fleet/r1/alive", "fleet/r1/front/color/alive", "fleet/r1/status/@adv/pub/abc/7/_"]


def test_keys_are_listed_and_read() -> None:
    (only,) = list_keys(PREFIX, KEYS)
    assert only == "fleet/r1/@alive/alive,front:color:alive,status:@adv:pub:abc:7:_"
    assert listed_keys(only) == KEYS
    assert zenoh.KeyExpr(lists_of("fleet/*/alive")).intersects(only)


def test_many_keys_take_several_lists() -> None:
    keys = [f"{PREFIX}/camera-{number:060}/color/alive" for number in range(300)]
    lists = list(list_keys(PREFIX, keys))
    assert len(lists) > 1
    assert all(len(each) <= MOST_CHARACTERS + 20 for each in lists)
    assert [key for each in lists for key in listed_keys(each)] == keys
    assert list(list_keys(PREFIX, [])) == []


@pytest.mark.parametrize(
    ("prefix", "key", "expected"),
    [
        (PREFIX, "fleet/r1/alive", True),
        (PREFIX, "fleet/r11/alive", False),
        (PREFIX, "fleet/r1", False),
        (PREFIX, "fleet/r1/a:b", False),
        (PREFIX, "fleet/r1/a,b", False),
        ("", "fleet/r1/alive", False),
    ],
)
def test_what_can_be_listed(prefix: str, key: str, *, expected: bool) -> None:
    assert can_list(prefix, key) == expected


@pytest.mark.parametrize(
    ("key_expr", "lists"),
    [
        ("fleet/*/*/color/alive", "fleet/*/@alive/*"),
        ("fleet/r1/**", "fleet/r1/@alive/*"),
        ("fleet/**", "fleet/*/@alive/*"),
        ("**", "fleet/*/@alive/*"),
        ("**/alive", "fleet/*/@alive/*"),
        ("*/r1/alive", "fleet/r1/@alive/*"),
        ("fleet", ""),
        ("*", ""),
        ("workers/**", ""),
    ],
)
def test_where_the_lists_of_an_expression_are(key_expr: str, lists: str) -> None:
    assert lists_of(key_expr) == lists


async def test_a_robot_shows_one_token_whatever_it_has() -> None:
    endpoint = free_endpoint()
    config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}}}}')
    async with (
        open_bus(router(endpoint)),
        open_bus(client(endpoint), prefix=PREFIX) as robot,
        open_bus(client(endpoint)) as here,
        here.watch("fleet/*/*/color/alive") as watch,
    ):
        with zenoh.open(config) as outside:
            async with robot.announce("fleet/r1/alive"), robot.announce("fleet/r1/back/color/alive"):
                assert await next_of(watch) == Presence("fleet/r1/back/color/alive", alive=True)
                async with robot.announce("fleet/r1/front/color/alive"), robot.announce("elsewhere"):
                    assert await next_of(watch) == Presence("fleet/r1/front/color/alive", alive=True)
                    await until(
                        lambda: (
                            shown(outside) == {"fleet/r1/@alive/alive,back:color:alive,front:color:alive", "elsewhere"}
                        )
                    )
                assert await next_of(watch) == Presence("fleet/r1/front/color/alive", alive=False)
            assert await next_of(watch) == Presence("fleet/r1/back/color/alive", alive=False)
            await until(lambda: not shown(outside))


def shown(session: zenoh.Session) -> set[str]:
    """Return the tokens that a session is told of, those with an @ as well."""
    replies = [*session.liveliness().get("**"), *session.liveliness().get("fleet/*/@alive/*")]
    return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}


@asynccontextmanager
async def watching() -> AsyncIterator[tuple[Watch, zenoh.Session]]:
    """Have a watch of all robots, and another program's session at the same router."""
    endpoint = free_endpoint()
    config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}}}}')
    async with open_bus(router(endpoint)), open_bus(client(endpoint)) as here, here.watch("fleet/*/**") as watch:
        with zenoh.open(config) as outside:
            yield watch, outside


async def test_a_list_of_another_program_is_read_as_far_as_it_holds_keys() -> None:
    async with watching() as (watch, outside):
        token = outside.liveliness().declare_token("fleet/r2/@alive/,a::b,x,x,:,y")
        found = [await next_of(watch), await next_of(watch)]
        token.undeclare()
        found += [await next_of(watch), await next_of(watch)]
    keys = ["fleet/r2/x", "fleet/r2/y"]
    assert found == [Presence(key, alive=alive) for alive in (True, False) for key in keys]


async def test_what_is_in_two_lists_is_there_until_it_is_in_neither() -> None:
    async with watching() as (watch, outside):
        first = outside.liveliness().declare_token("fleet/r2/@alive/x")
        assert await next_of(watch) == Presence("fleet/r2/x", alive=True)
        second = outside.liveliness().declare_token("fleet/r2/@alive/x,y")
        assert await next_of(watch) == Presence("fleet/r2/y", alive=True)
        first.undeclare()
        other = outside.liveliness().declare_token("fleet/r2/z")
        assert await next_of(watch) == Presence("fleet/r2/z", alive=True)
        second.undeclare()
        assert {await next_of(watch), await next_of(watch)} == {
            Presence("fleet/r2/x", alive=False),
            Presence("fleet/r2/y", alive=False),
        }
        other.undeclare()


async def test_a_token_that_is_in_a_list_and_shown_by_itself_is_there_until_it_is_neither() -> None:
    async with watching() as (watch, outside):
        listed = outside.liveliness().declare_token("fleet/r2/@alive/x")
        assert await next_of(watch) == Presence("fleet/r2/x", alive=True)
        direct = outside.liveliness().declare_token("fleet/r2/x")
        other = outside.liveliness().declare_token("fleet/r2/y")
        assert await next_of(watch) == Presence("fleet/r2/y", alive=True)
        direct.undeclare()
        other.undeclare()
        assert await next_of(watch) == Presence("fleet/r2/y", alive=False)
        listed.undeclare()
        assert await next_of(watch) == Presence("fleet/r2/x", alive=False)


async def test_a_list_that_is_longer_than_any_of_ours_is_left_out(caplog: pytest.LogCaptureFixture) -> None:
    async with watching() as (watch, outside):
        names = ",".join(f"n{number}" for number in range(5_000))
        endless = outside.liveliness().declare_token(f"fleet/r2/@alive/{names}")
        other = outside.liveliness().declare_token("fleet/r2/@alive/y")
        assert await next_of(watch) == Presence("fleet/r2/y", alive=True)
        endless.undeclare()
        other.undeclare()
        assert await next_of(watch) == Presence("fleet/r2/y", alive=False)
    assert f"left out: a list of {len(names) + 16} characters" in caplog.text


async def test_a_late_watch_and_a_late_subscription_share_what_is_known() -> None:
    endpoint = free_endpoint()
    async with (
        open_bus(router(endpoint)),
        open_bus(client(endpoint), prefix=PREFIX) as robot,
        open_bus(client(endpoint)) as here,
        robot.announce("fleet/r1/alive"),
        robot.publisher("fleet/r1/status", QoS.STATUS) as out,
        here.watch("fleet/*/alive") as first,
    ):
        out.put(b"kept")
        assert await next_of(first) == Presence("fleet/r1/alive", alive=True)
        async with here.watch("fleet/*/alive") as second, here.subscribe("fleet/*/status", QUEUE(9)) as statuses:
            assert await next_of(second) == Presence("fleet/r1/alive", alive=True)
            assert (await next_of(statuses)).payload == b"kept"


async def test_lists_are_shown_and_read_again_on_the_next_session() -> None:
    endpoint = free_endpoint()
    settings = BusSettings(connect=[endpoint], lease_s=1.0)
    async with (
        open_bus(settings, prefix=PREFIX) as robot,
        open_bus(settings) as here,
        robot.publisher("fleet/r1/status", QoS.STATUS) as out,
        robot.announce("fleet/r1/alive"),
        here.watch("fleet/*/alive") as watch,
        here.subscribe("fleet/*/status", QUEUE(9)) as statuses,
    ):
        for number in range(2):
            async with open_bus(router(endpoint)):
                assert await next_of(watch) == Presence("fleet/r1/alive", alive=True)
                out.put(b"%d" % number)
                assert (await next_of(statuses)).payload == b"%d" % number
            assert await next_of(watch) == Presence("fleet/r1/alive", alive=False)


def test_what_is_followed_leaves_room_for_every_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(token_lists, "MOST_OF_ROBOT", 2)
    monkeypatch.setattr(token_lists, "MOST_FOLLOWED", 4)
    followed = FollowedTokens()
    assert [followed.add(f"fleet/r1/{name}") for name in "abbc"] == [True, True, True, False]
    assert [followed.add(f"fleet/r{number}/a") for number in (2, 3, 4)] == [True, True, False]
    assert not followed.has_much_room
    followed.remove("fleet/r1/a")
    assert followed.has_much_room
    assert "fleet/r1/a" not in followed
    assert [followed.add("fleet/r1/c"), followed.add("fleet/r1/d")] == [True, False]
    assert set(followed) == {"fleet/r1/b", "fleet/r1/c", "fleet/r2/a", "fleet/r3/a"}


@pytest.mark.parametrize("shown", [["a:alive,b:alive,c:alive"], ["a:alive", "b:alive", "c:alive"]])
async def test_tokens_of_one_robot_without_end_leave_the_others_theirs(
    shown: list[str], caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(token_lists, "MOST_OF_ROBOT", 2)
    async with watching() as (watch, outside):
        flood = [outside.liveliness().declare_token(f"fleet/r2/@alive/{names}") for names in shown]
        others = [outside.liveliness().declare_token(f"fleet/{robot}/@alive/front:alive") for robot in ("r3", "r4")]
        here = {(await next_of(watch)).key for _ in range(4)}
        assert here == {"fleet/r2/a/alive", "fleet/r2/b/alive", "fleet/r3/front/alive", "fleet/r4/front/alive"}
        newer = outside.liveliness().declare_token("fleet/r2/@alive/a:alive,b:alive")
        await until(lambda: "left out" in caplog.text)
        for token in (*flood, *others):
            token.undeclare()
        assert {(await next_of(watch)).key for _ in range(2)} == {"fleet/r3/front/alive", "fleet/r4/front/alive"}
        newer.undeclare()
        assert {(await next_of(watch)).key for _ in range(2)} == {"fleet/r2/a/alive", "fleet/r2/b/alive"}
    assert "presence of fleet/r2 is left out" in caplog.text


async def test_what_was_left_out_is_there_once_there_is_room(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(token_lists, "MOST_FOLLOWED", 4)
    monkeypatch.setattr(listed_tokens, "ASK_AGAIN_S", 0.05)
    async with watching() as (watch, outside):
        flood = outside.liveliness().declare_token("fleet/r1/@alive/a,b,c")
        assert {(await next_of(watch)).key for _ in range(3)} == {"fleet/r1/a", "fleet/r1/b", "fleet/r1/c"}
        partly = outside.liveliness().declare_token("fleet/r2/@alive/a,b")
        first = await next_of(watch)
        late = outside.liveliness().declare_token("fleet/r3/@alive/a")
        await until(lambda: "presence of fleet/r3 is left out" in caplog.text)
        flood.undeclare()
        seen = [await next_of(watch) for _ in range(5)]
        assert {each.key for each in seen if not each.alive} == {"fleet/r1/a", "fleet/r1/b", "fleet/r1/c"}
        assert {first.key, *(each.key for each in seen if each.alive)} == {"fleet/r2/a", "fleet/r2/b", "fleet/r3/a"}
        partly.undeclare()
        late.undeclare()
        assert {(await next_of(watch)).alive for _ in range(3)} == {False}
