"""The fleet as it changes, over a WebSocket: items are made once for all, and a client gets only changes."""

import asyncio
import json
import time
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Final, Literal, get_args

from fastapi import APIRouter, Query, WebSocket, WebSocketDisconnect

from schemas.alerts import Alert
from services.monitor.event_loop.cached_value import CachedValue
from services.monitor.event_loop.cooperative_yielding import in_turns
from services.monitor.formats import moment
from services.monitor.history.state import HistoryError
from services.monitor.monitor import MAX_AGE_S, Monitor
from services.monitor.web.api.live_items import Found, Name, of_alert, of_entry, of_snapshot, of_worker, of_world
from services.monitor.web.auth.users import visitor_of

Topic = Literal[
    "robots", "cameras", "inventory", "alerts", "workers", "gateways", "sites", "zones", "warehouses", "objects"
]
TOPICS: Final[tuple[Topic, ...]] = get_args(Topic)

UNLESS_CHOSEN: Final = TOPICS[: TOPICS.index("objects")]
"""The topics of a client that chooses none: of objects there may be a hundred thousand."""

RENEW_S: Final = 10.0
"""Seconds between updates of items of which only times, rates and scores change."""


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    """One item of a topic. state: a new item is sent when it changes. body: JSON, as in the API."""

    state: Hashable
    body: str
    made_s: float
    robot: str


Items = Mapping[Name, Item]


class Feed:
    """Makes items, and caches each until its state changes."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._items: dict[Topic, Items] = {}
        self._recent = {topic: CachedValue(partial(self._make, topic), MAX_AGE_S) for topic in TOPICS}

    async def current(self, topics: Iterable[Topic]) -> tuple[str, Mapping[Topic, Items]]:
        """Return the time, and every item of these topics by name; read only.

        A topic is left out while it is not known what there is of it.
        """
        found = {topic: items for topic in topics if (items := await self._recent[topic].get()) is not None}
        return moment(time.time_ns()).isoformat().replace("+00:00", "Z"), found

    async def _make(self, topic: Topic) -> Items | None:
        try:
            found = await self._found(topic)
        except HistoryError:
            return self._items.get(topic)  # the last known items
        made = {each[0]: self._item(topic, each) async for each in in_turns(found)}
        self._items[topic] = made
        return made

    async def _found(self, topic: Topic) -> Iterable[Found]:
        match topic:
            case "robots" | "cameras" | "gateways":
                return of_snapshot(topic, await self._monitor.snapshot())
            case "inventory":
                return map(of_entry, await self._monitor.inventory())
            case "alerts":
                return self._of_alerts(await self._monitor.current_alerts())
            case "workers":
                return map(of_worker, self._monitor.workers().lines)
            case _:
                return of_world(topic, self._monitor.fleet, time.time_ns())

    def _of_alerts(self, alerts: Iterable[Alert]) -> Iterator[Found]:
        for alert in alerts:
            acts, known_until_ns = self._monitor.acts_of(alert.id), self._monitor.known_until_ns(alert)
            yield of_alert(alert, acts, known_until_ns)

    def _item(self, topic: Topic, found: Found) -> Item:
        name, state, robot, body = found
        old, now_s = self._items.get(topic, {}).get(name), time.monotonic()
        if old is not None and old.state == state and now_s - old.made_s < RENEW_S:
            return old
        return Item(state, body(), now_s, robot)


MAX_CLIENTS: Final = 100
MAX_OF_USER: Final = 25
TRY_AGAIN_LATER: Final = 1013

Topics = Annotated[
    Sequence[Topic], Query(max_length=len(TOPICS), description="topics to send; all but objects by default")
]
Period = Annotated[float, Query(ge=MAX_AGE_S, le=60, description="minimum seconds between two messages")]
Robot = Annotated[str, Query(max_length=64, description="only this robot")]


class LiveClient:
    """The state already sent to one client; only differences are sent, so nothing queues. Pure."""

    def __init__(self, topics: Iterable[Topic], robot: str) -> None:
        self._robot = robot
        self._sent: dict[Topic, dict[Name, Item] | None] = dict.fromkeys(topics)

    @property
    def topics(self) -> Iterable[Topic]:
        """The client's topics."""
        return self._sent

    def news(self, now: str, current: Mapping[Topic, Mapping[Name, Item]]) -> str:
        """Return the changes as JSON, and mark them as sent; empty if there are none.

        An empty topic is sent once. A topic that is not in `current` is unknown.
        """
        known = [(topic, current[topic]) for topic in self._sent if topic in current]
        parts = [part for topic, items in known if (part := self._news_of(topic, items))]
        return "{" + ",".join([f'"now":{json.dumps(now)}', *parts]) + "}" if parts else ""

    def _news_of(self, topic: Topic, current: Mapping[Name, Item]) -> str:
        sent = self._sent[topic]
        mine = {name: item for name, item in current.items() if self._robot in ("", item.robot)}
        before = sent or {}
        changed = [item.body for name, item in mine.items() if before.get(name) is not item]
        gone = [list(name) for name in before if name not in mine]
        self._sent[topic] = mine
        is_news = changed or gone or sent is None
        return f'"{topic}":{{"changed":[{",".join(changed)}],"gone":{json.dumps(gone)}}}' if is_news else ""


def live_routes(monitor: Monitor) -> APIRouter:
    """Return the route."""
    router = APIRouter()
    feed = Feed(monitor)
    clients: dict[LiveClient, str] = {}

    @router.websocket("/live")
    async def live(
        socket: WebSocket,
        topic: Topics = UNLESS_CHOSEN,
        robot: Robot = "",
        period_s: Period = 1.0,
    ) -> None:
        client = LiveClient(dict.fromkeys(topic), robot)
        await socket.accept()
        name = visitor_of(socket).name
        if list(clients.values()).count(name) >= MAX_OF_USER:
            await socket.close(TRY_AGAIN_LATER, f"you already have {MAX_OF_USER} of these open")
            return
        if len(clients) >= MAX_CLIENTS:
            await socket.close(TRY_AGAIN_LATER, "too many clients")
            return
        clients[client] = name
        try:
            async with asyncio.TaskGroup() as group:
                sending = group.create_task(_send(socket, client, feed, period_s))
                await _until_gone(socket)
                sending.cancel()
        except* WebSocketDisconnect:
            pass
        finally:
            del clients[client]

    return router


async def _send(socket: WebSocket, client: LiveClient, feed: Feed, period_s: float) -> None:
    while True:
        sent_s = time.monotonic()
        news = client.news(*await feed.current(client.topics))
        if news:
            # waits until the client takes it; later changes are sent in their newest state
            await socket.send_text(news)
        await asyncio.sleep(max(0.0, sent_s + period_s - time.monotonic()))


async def _until_gone(socket: WebSocket) -> None:
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass
