"""The fleet as it changes, over a WebSocket: items are made once for all, and a client gets only changes."""

import asyncio
import json
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Final, Literal, get_args

from fastapi import APIRouter, Query, WebSocket, WebSocketDisconnect

from schemas.alerts import Alert
from schemas.status import GatewayStatus
from services.monitor.event_loop import CachedValue, in_turns
from services.monitor.formats import moment
from services.monitor.history.state import Act, HistoryError
from services.monitor.inventory.inventory import Entry
from services.monitor.monitor import MAX_AGE_S, Monitor
from services.monitor.snapshot import CameraLine, RobotLine, WorkerLine
from services.monitor.web.api.bodies import (
    alert_answer,
    camera_body,
    encoded,
    gateway_answer,
    robot_body,
    sighting_body,
    worker_answer,
)

Topic = Literal["robots", "cameras", "inventory", "alerts", "workers", "gateways"]
TOPICS: Final[tuple[Topic, ...]] = get_args(Topic)

RENEW_S: Final = 10.0
"""Seconds between updates of items of which only times, rates and scores change."""

Name = tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    """One item of a topic. state: a new item is sent when it changes. body: JSON, as in the API."""

    state: Hashable
    body: str
    made_s: float
    robot: str


Items = Mapping[Name, Item]

Found = tuple[Name, Hashable, str, Callable[[], str]]
"""The parts of an item: name, state, robot, and a function that makes its JSON."""


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
            case "robots":
                return map(_of_robot, (await self._monitor.snapshot()).robots)
            case "cameras":
                return map(_of_camera, (await self._monitor.snapshot()).cameras)
            case "inventory":
                return map(_of_entry, await self._monitor.inventory())
            case "alerts":
                return self._of_alerts(await self._monitor.current_alerts())
            case "workers":
                return map(_of_worker, self._monitor.workers().lines)
            case "gateways":
                robots = (await self._monitor.snapshot()).robots
                return (_of_gateway(robot, robot.gateway) for robot in robots if robot.gateway is not None)

    def _of_alerts(self, alerts: Iterable[Alert]) -> Iterator[Found]:
        for alert in alerts:
            acts, known_until_ns = self._monitor.acts_of(alert.id), self._monitor.known_until_ns(alert)
            state = (alert, acts, known_until_ns)
            yield (alert.id,), state, alert.robot, partial(_alert_json, alert, acts, known_until_ns)

    def _item(self, topic: Topic, found: Found) -> Item:
        name, state, robot, body = found
        old, now_s = self._items.get(topic, {}).get(name), time.monotonic()
        if old is not None and old.state == state and now_s - old.made_s < RENEW_S:
            return old
        return Item(state, body(), now_s, robot)


def _alert_json(alert: Alert, acts: tuple[Act, ...], known_until_ns: int | None) -> str:
    return alert_answer(alert, acts, known_until_ns).model_dump_json(by_alias=True)


def _of_robot(robot: RobotLine) -> Found:
    state = (robot.online, robot.problems, robot.cameras, _counts(robot.dropped))
    return (robot.name,), state, robot.name, lambda: encoded(robot_body(robot)).decode()


def _of_camera(camera: CameraLine) -> Found:
    row, key = camera.row, camera.key
    seen = None if row.classes is None else tuple((each.name, each.count) for each in row.classes)
    state = (row.online, row.stale, seen, camera.served_by, _counts(camera.dropped))
    return (key.robot, key.camera), state, key.robot, lambda: encoded(camera_body(camera)).decode()


def _of_entry(entry: Entry) -> Found:
    of = entry.sighting
    near = None if of.nearest_m is None else round(of.nearest_m, 1)
    state = (of.count, of.first_ns, entry.available, near, of.model)
    return (of.key.robot, of.key.camera, of.name), state, of.key.robot, lambda: encoded(sighting_body(entry)).decode()


def _of_worker(worker: WorkerLine) -> Found:
    status = worker.status
    loads = tuple((load.robot, load.camera, load.serving) for load in status.cameras)
    state = (worker.online, status.model, loads, tuple(status.remarks), status.version)
    name = (status.service, status.worker)
    return name, state, "", lambda: worker_answer(worker).model_dump_json(by_alias=True)


def _of_gateway(robot: RobotLine, of: GatewayStatus) -> Found:
    streams = tuple((each.name, each.topic, each.wanted, each.publishers, each.problem) for each in of.streams)
    returns = tuple((each.camera, each.stream, each.wanted) for each in of.returns)
    state = (robot.online, of.waiting_for, of.clock_jumps, streams, returns, of.version)
    return (
        (of.robot,),
        state,
        of.robot,
        lambda: gateway_answer(of, robot.last_ns, online=robot.online).model_dump_json(by_alias=True),
    )


def _counts(dropped: Mapping[str, int]) -> Hashable:
    return tuple(sorted(dropped.items()))


MAX_CLIENTS: Final = 100
TRY_AGAIN_LATER: Final = 1013

Topics = Annotated[Sequence[Topic], Query(max_length=len(TOPICS), description="topics to send; all by default")]
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
    clients: set[LiveClient] = set()

    @router.websocket("/live")
    async def live(
        socket: WebSocket,
        topic: Topics = TOPICS,
        robot: Robot = "",
        period_s: Period = 1.0,
    ) -> None:
        client = LiveClient(dict.fromkeys(topic), robot)
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
