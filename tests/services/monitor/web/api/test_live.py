"""Live data over a WebSocket."""

import asyncio
import json
import logging
import re
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Any, Never

import msgspec
import pytest
import websockets
from websockets.asyncio.client import ClientConnection

from bus.fake import FakeNetwork
from services.monitor.history.state import HistoryError
from services.monitor.history.store import Store
from services.monitor.web.api import live as live_module
from services.monitor.web.api.live import TOPICS, UNLESS_CHOSEN, Feed, Item, LiveClient, Topic
from services.monitor.web.auth.users import Role
from tests.services.monitor.web.api.seeing import ODD, fill, see
from tests.services.monitor.web.api.test_alerts import alert, raise_alert
from tests.services.monitor.web.pages.rows.test_warehouses import report_of
from tests.services.monitor.web.serving import Served, monitor_on, served, token_of
from tests.services.monitor.world.test_site_objects import tell_of, thing


async def test_nothing_is_made_that_nobody_asked_for() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        fill(monitor.fleet)
        now, found = await Feed(monitor).current(["workers", "alerts"])
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT[\d:.]+Z", now), "as the other answers write it"
        assert {topic: list(items) for topic, items in found.items()} == {"workers": [("detector", "w1")], "alerts": []}
        assert monitor._snapshot._made is None
        assert monitor._inventory._made is None


async def test_it_is_news_that_nobody_knows_any_more_what_an_alert_says() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        fill(monitor.fleet)
        raise_alert(monitor, msgspec.structs.replace(alert(), camera="front"))
        feed = Feed(monitor)
        _, first = await feed.current(["alerts"])
        assert json.loads(first["alerts"]["a1",].body)["known_until"] is None
        monitor.fleet.robot_presence("r1", alive=False)
        feed._recent["alerts"]._made = None
        _, then = await feed.current(["alerts"])
        assert json.loads(then["alerts"]["a1",].body)["known_until"]


async def test_of_alerts_that_cannot_be_read_nothing_is_said_until_they_can(tmp_path: Path) -> None:
    database = tmp_path / "history.db"
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus, history=f"sqlite:///{database}")
        feed = Feed(monitor)

        async def found() -> list[Topic]:
            feed._recent["alerts"]._made = monitor._others._made = None
            return list((await feed.current(["workers", "alerts"]))[1])

        database.mkdir()
        assert await found() == ["workers"]
        database.rmdir()
        store = await Store.open(f"sqlite:///{database}")
        await store.close()
        assert await found() == ["workers", "alerts"]
        monitor.archive.alerts = failing  # type: ignore[method-assign]
        assert await found() == ["workers", "alerts"], "as far as anybody knows"
        await monitor.history._end()


async def failing(*_: object, **__: object) -> Never:
    raise HistoryError("gone")


async def test_what_is_no_news_stays_the_same_item() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        fill(monitor.fleet)
        feed = Feed(monitor)
        _, first = await feed.current(TOPICS)
        assert json.loads(first["cameras"]["r1", "front"].body)["classes"] == [{"name": ODD, "count": 2, "score": 0.5}]
        see(monitor.fleet, 2, 1)
        for recent in feed._recent.values():
            recent._made = None
        monitor._snapshot._made = monitor._inventory._made = None
        _, then = await feed.current(TOPICS)
        assert then["cameras"] == first["cameras"], "one list alone moves no count"
        assert then["inventory"] == first["inventory"]


async def test_sites_their_objects_and_warehouses_change_like_the_rest() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        tell_of(monitor.fleet, thing("a", 1), thing("b", 2))
        report_of(monitor.fleet, "berlin")
        feed = Feed(monitor)

        async def told() -> dict[Topic, dict[tuple[str, ...], Item]]:
            for recent in feed._recent.values():
                recent._made = None
            _, found = await feed.current(["sites", "zones", "objects", "warehouses"])
            return {topic: dict(items) for topic, items in found.items()}

        first = await told()
        assert {topic: list(items) for topic, items in first.items()} == {
            "sites": [("hall",)],
            "zones": [],
            "objects": [("hall", "a"), ("hall", "b")],
            "warehouses": [("berlin",)],
        }
        assert json.loads(first["objects"]["hall", "a"].body)["x"] == 1
        assert json.loads(first["warehouses"]["berlin",].body)["objects"] == {"box": 5, "pallet": 2}
        tell_of(monitor.fleet, thing("a", 1), thing("b", 5))
        then = await told()
        assert then["objects"]["hall", "a"] is first["objects"]["hall", "a"], "it did not move"
        assert json.loads(then["objects"]["hall", "b"].body)["x"] == 5
        assert then["warehouses"] == first["warehouses"]
        report_of(monitor.fleet, "berlin", robots_online=0)
        assert json.loads((await told())["warehouses"]["berlin",].body)["robots_online"] == 0
        assert "objects" not in UNLESS_CHOSEN


def item(body: str, robot: str = "r1") -> Item:
    return Item(body, f'"{body}"', 0.0, robot)


def test_a_client_is_told_what_is_new_to_it_and_what_is_gone() -> None:
    client, one, two = LiveClient(["robots", "alerts"], ""), item("one"), item("two")
    assert client.news("t", {}) == ""
    first = json.loads(client.news("t", {"robots": {("r1",): one, ("r2",): two}, "cameras": {("r1", "x"): one}}))
    assert first == {"now": "t", "robots": {"changed": ["one", "two"], "gone": []}}
    assert client.news("t", {"robots": {("r1",): one, ("r2",): two}}) == ""
    changed = item("other")
    then = json.loads(client.news("t", {"robots": {("r1",): changed}, "alerts": {("a",): two}}))
    assert then["robots"] == {"changed": ["other"], "gone": [["r2"]]}
    assert then["alerts"]["changed"] == ["two"]


def test_that_there_is_nothing_of_a_topic_is_told_once() -> None:
    client = LiveClient(["robots", "alerts"], "")
    empty: dict[str, list[str]] = {"changed": [], "gone": []}
    assert json.loads(client.news("t", {"robots": {}, "cameras": {}})) == {"now": "t", "robots": empty}
    assert client.news("t", {"robots": {}}) == "", "of alerts nothing is known yet"
    assert json.loads(client.news("t", {"robots": {}, "alerts": {}})) == {"now": "t", "alerts": empty}
    assert client.news("t", {"robots": {}, "alerts": {}}) == ""
    assert client.news("t", {}) == "", "what is not known now did not go"


def test_a_client_is_told_of_the_robot_it_asked_for_alone() -> None:
    client = LiveClient(["robots"], "r2")
    assert json.loads(client.news("t", {"robots": {("r1",): item("one")}}))["robots"]["changed"] == []
    assert json.loads(client.news("t", {"robots": {("r2",): item("two", "r2")}}))["robots"]["changed"] == ["two"]


def live(at: Served, query: str = "", *, path: str = "", **headers: str) -> Any:
    given = headers or {"Authorization": f"Bearer {at.token}"}
    asked = path or f"/api/v1/live?period_s=0.5{query}"
    return websockets.connect(at.url.replace("http", "ws") + asked, additional_headers=given)


async def next_of(socket: ClientConnection) -> Any:
    async with asyncio.timeout(20):
        return json.loads(await socket.recv())


async def test_the_fleet_as_it_changes_over_a_real_socket(caplog: pytest.LogCaptureFixture) -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        fill(monitor.fleet)
        async with served(monitor) as at:
            async with live(at, "&robot=r1") as socket:
                first = await next_of(socket)
                assert [each["name"] for each in first["robots"]["changed"]] == ["r1"]
                assert first["inventory"]["changed"][0]["class"] == ODD
                see(monitor.fleet, 2, 3)
                see(monitor.fleet, 3, 3)
                then = await next_of(socket)
                while not then.get("cameras"):
                    then = await next_of(socket)
                assert then["cameras"]["changed"][0]["classes"] == [{"name": ODD, "count": 3, "score": 0.5}]
                monitor.fleet.robot_presence("r1", alive=False)
                then = await next_of(socket)
                while "robots" not in then:
                    then = await next_of(socket)
                assert then["robots"]["changed"][0]["online"] is False
            async with live(at, "&robot=zz") as socket:
                first = await next_of(socket)
                assert set(first) == {"now", *UNLESS_CHOSEN}
                others = [first[topic] for topic in UNLESS_CHOSEN if topic != "workers"]
                assert others == [{"changed": [], "gone": []}] * 8
            await refused(at)
    assert not [each.message for each in caplog.records if each.levelno >= logging.WARNING]


async def refused(at: Served) -> None:
    cookie = "=".join(at.cookie)
    unknown = "log in, or send a token: Authorization: Bearer ..."
    for headers, status, reason in (
        ({"X": "nobody"}, 401, unknown),
        ({"Authorization": "Bearer x"}, 401, unknown),
        (
            {"Cookie": cookie, "Origin": "http://evil.test"},
            403,
            "this request does not come from a page of this monitor",
        ),
        ({"Cookie": cookie}, 403, "this request does not come from a page of this monitor"),
    ):
        assert await refusal(at, **headers) == (status, reason)
    async with live(at, "&topic=cameras&topic=robots", Cookie=cookie, Origin=at.url) as browser:
        assert set(await next_of(browser)) == {"now", "cameras", "robots"}
    for query, reason in (
        ("&topic=odd", "topic.0: Input should be 'robots', 'cameras', "),
        ("&robot=" + "x" * 65, "robot: String should have at most 64 characters"),
        ("&robt=r1", "unknown parameter 'robt': known are period_s, robot, topic"),
        ("&robot=r1&robot=r2", "'robot' is given more than once"),
        ("&period_s=1", "'period_s' is given more than once"),
    ):
        status, told = await refusal(at, query)
        assert (status, told[: len(reason)]) == (422, reason)
    period = {"0": "greater than or equal to 0.5", "61": "less than or equal to 60", "abc": "a valid number"}
    for given, wanted in period.items():
        status, told = await refusal(at, path=f"/api/v1/live?period_s={given}")
        assert (status, told.startswith("period_s: Input should be"), wanted in told) == (422, True, True)
    assert await refusal(at, path="/api/v1/life") == (404, "there is no WebSocket at /api/v1/life")


async def refusal(at: Served, query: str = "", *, path: str = "", **headers: str) -> tuple[int, str]:
    """Return the status and the reason with which a socket is refused."""
    with pytest.raises(websockets.InvalidStatus) as refused_with:
        async with live(at, query, path=path, **headers):
            pass
    response = refused_with.value.response
    assert (response.headers["Content-Type"], response.headers["Cache-Control"]) == ("application/json", "no-store")
    told = json.loads(response.body)
    assert list(told) == ["error"]
    return response.status_code, told["error"]


async def test_who_is_logged_out_hears_no_more() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        fill(monitor.fleet)
        async with served(monitor, Role.VIEWER) as at:
            cookie = "=".join(at.cookie)
            async with live(at, Cookie=cookie, Origin=at.url) as browser:
                await next_of(browser)
                out = await _post(at, "/logout", cookie)
                assert out.startswith("HTTP/1.1 303")
                async with asyncio.timeout(20):
                    await browser.wait_closed()
                assert browser.close_code == 1008


async def test_one_user_leaves_live_data_to_others(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(live_module, "MAX_OF_USER", 2)
    async with (
        FakeNetwork().open_bus() as bus,
        served(monitor_on(bus), folder=tmp_path) as at,
        live(at) as first,
        live(at) as second,
    ):
        for socket in (first, second):
            await next_of(socket)
        async with live(at) as third:
            await third.wait_closed()
            assert (third.close_code, third.close_reason) == (1013, "you already have 2 of these open")
        other = await token_of(at.access, tmp_path, Role.VIEWER)
        async with live(at, Authorization=f"Bearer {other}") as others:
            assert set(await next_of(others)) == {"now", *UNLESS_CHOSEN}
        await first.close()
        async with asyncio.timeout(20), AsyncExitStack() as stack:
            while True:
                fourth = await stack.enter_async_context(live(at))
                with suppress(websockets.ConnectionClosed):
                    assert set(await next_of(fourth)) == {"now", *UNLESS_CHOSEN}
                    break


async def _post(at: Served, path: str, cookie: str) -> str:
    host = at.url.removeprefix("http://")
    reader, writer = await asyncio.open_connection(*host.split(":"))
    head = f"POST {path} HTTP/1.1\r\nHost: {host}\r\nOrigin: {at.url}\r\nCookie: {cookie}\r\nContent-Length: 0\r\n\r\n"
    writer.write(head.encode())
    async with asyncio.timeout(20):
        answer = (await reader.readline()).decode()
    writer.close()
    await writer.wait_closed()
    return answer
