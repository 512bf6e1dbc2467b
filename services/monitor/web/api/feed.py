"""Items for clients of live data, made once for all clients, and only if one asks for them."""

import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal, get_args

from schemas.alerts import Alert
from schemas.status import GatewayStatus
from services.monitor.event_loop import in_turns
from services.monitor.formats import moment
from services.monitor.history.errors import HistoryError
from services.monitor.history.operator_actions import Act
from services.monitor.inventory.inventory import Entry
from services.monitor.monitor import MAX_AGE_S, Monitor
from services.monitor.recent import CachedValue
from services.monitor.snapshot import CameraLine, RobotLine, WorkerLine
from services.monitor.web.api.bodies import camera_body, encoded, robot_body, sighting_body
from services.monitor.web.api.models import alert_answer, gateway_answer, worker_answer

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
