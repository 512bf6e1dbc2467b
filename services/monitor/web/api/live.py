"""The fleet as it changes, over a WebSocket: each client gets only changes, as fast as it takes them."""

import asyncio
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Final

from fastapi import APIRouter, Query, WebSocket, WebSocketDisconnect

from services.monitor.monitor import MAX_AGE_S, Monitor
from services.monitor.web.api.feed import TOPICS, Feed, Item, Name, Topic

MAX_CLIENTS: Final = 100
TRY_AGAIN_LATER: Final = 1013

Topics = Annotated[Sequence[Topic], Query(max_length=len(TOPICS), description="topics to send; all by default")]
Period = Annotated[float, Query(ge=MAX_AGE_S, le=60, description="minimum seconds between two messages")]
Robot = Annotated[str, Query(max_length=64, description="only this robot")]


class Client:
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

        That there is nothing of a topic is news, too, once. Of one that is not in `current` nothing is known.
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
    clients: set[Client] = set()

    @router.websocket("/live")
    async def live(
        socket: WebSocket,
        topic: Topics = TOPICS,
        robot: Robot = "",
        period_s: Period = 1.0,
    ) -> None:
        client = Client(dict.fromkeys(topic), robot)
        await socket.accept()
        if len(clients) >= MAX_CLIENTS:
            await socket.close(TRY_AGAIN_LATER, "too many clients")
            return
        clients.add(client)
        try:
            async with asyncio.TaskGroup() as group:
                sending = group.create_task(_send(socket, client, feed, period_s))
                await _until_gone(socket)
                sending.cancel()
        except* WebSocketDisconnect:
            pass
        finally:
            clients.discard(client)

    return router


async def _send(socket: WebSocket, client: Client, feed: Feed, period_s: float) -> None:
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
