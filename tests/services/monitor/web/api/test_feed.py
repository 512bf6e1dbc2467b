import json
import re
from pathlib import Path
from typing import Never

import msgspec

from bus.fake import FakeNetwork
from services.monitor.history.state import HistoryError
from services.monitor.history.store import Store
from services.monitor.web.api.live import TOPICS, Feed, Topic
from tests.services.monitor.web.api.seeing import ODD, fill, see
from tests.services.monitor.web.api.test_alerts import alert, raise_alert
from tests.services.monitor.web.serving import monitor_on


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
