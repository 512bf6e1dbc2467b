"""Everything that clients of the live data are sent, made once for all of them."""

import asyncio
import time
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal, TypeVar, get_args

from pydantic import BaseModel

from services.monitor.history.errors import HistoryError
from services.monitor.inventory.inventory import Entry
from services.monitor.monitor import AT_ONCE, MAX_AGE_S, Monitor
from services.monitor.picture import CameraLine, RobotLine, WorkerLine
from services.monitor.recent import Recent
from services.monitor.web.api.models import (
    alert_answer,
    camera_answer,
    moment,
    robot_answer,
    sighting_answer,
    worker_answer,
)

Topic = Literal["robots", "cameras", "inventory", "alerts", "workers"]
TOPICS: Final[tuple[Topic, ...]] = get_args(Topic)

RENEW_S: Final = 10.0
"""How often something is sent again of which only times, rates and scores change."""

Name = tuple[str, ...]
T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    """One robot, camera, sighting, alert or worker. state: what makes it news. body: JSON, as the API answers it."""

    state: Hashable
    body: str
    made_s: float
    robot: str


Found = tuple[Topic, Name, Hashable, str, Callable[[], BaseModel]]
"""What an item is made of: topic, name, state, robot, and what makes its answer."""


class Feed:
    """Makes items, and keeps each as long as it is no news."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._items: dict[Topic, dict[Name, Item]] = {topic: {} for topic in TOPICS}
        self._recent = Recent(self._make, MAX_AGE_S)

    async def current(self) -> tuple[str, Mapping[Topic, Mapping[Name, Item]]]:
        """Return the time, and every item by topic and name; nobody is to change them."""
        return await self._recent.get()

    async def _make(self) -> tuple[str, Mapping[Topic, Mapping[Name, Item]]]:
        picture, entries = await self._monitor.picture(), await self._monitor.inventory()
        made: dict[Topic, dict[Name, Item]] = {topic: {} for topic in TOPICS}
        found = _found(picture.robots, picture.cameras, entries, picture.workers)
        for number, each in enumerate(found, 1):
            made[each[0]][each[1]] = self._item(each)
            if number % AT_ONCE == 0:
                await asyncio.sleep(0)
        try:
            for alert in await self._monitor.current_alerts():
                acts = self._monitor.acts_of(alert.id)
                answer = partial(alert_answer, alert, acts)
                found_alert: Found = ("alerts", (alert.id,), (alert, acts), alert.robot, answer)
                made["alerts"][alert.id,] = self._item(found_alert)
        except HistoryError:
            made["alerts"] = self._items["alerts"]  # as far as anybody knows
        self._items = made
        return moment(picture.now_ns).isoformat(), made

    def _item(self, found: Found) -> Item:
        topic, name, state, robot, answer = found
        old, now_s = self._items[topic].get(name), time.monotonic()
        if old is not None and old.state == state and now_s - old.made_s < RENEW_S:
            return old
        return Item(state, answer().model_dump_json(by_alias=True), now_s, robot)


def _found(
    robots: tuple[RobotLine, ...],
    cameras: tuple[CameraLine, ...],
    entries: tuple[Entry, ...],
    workers: tuple[WorkerLine, ...],
) -> Iterator[Found]:
    for robot in robots:
        state: Hashable = (robot.online, robot.problems, robot.cameras, _counts(robot.dropped))
        yield "robots", (robot.name,), state, robot.name, partial(robot_answer, robot)
    for camera in cameras:
        row, key = camera.row, camera.key
        seen = None if row.classes is None else tuple((each.name, each.count) for each in row.classes)
        state = (row.online, row.stale, seen, camera.served_by, _counts(camera.dropped))
        yield "cameras", (key.robot, key.camera), state, key.robot, partial(camera_answer, camera)
    for entry in entries:
        of = entry.sighting
        near = None if of.nearest_m is None else round(of.nearest_m, 1)
        state = (of.count, of.first_ns, entry.available, near, of.model)
        name = (of.key.robot, of.key.camera, of.name)
        yield "inventory", name, state, of.key.robot, partial(sighting_answer, entry)
    for worker in workers:
        status = worker.status
        loads = tuple((load.robot, load.camera, load.serving) for load in status.cameras)
        state = (worker.online, status.model, loads, tuple(status.remarks))
        yield "workers", (status.service, status.worker), state, "", partial(worker_answer, worker)


def _counts(dropped: Mapping[str, int]) -> Hashable:
    return tuple(sorted(dropped.items()))
