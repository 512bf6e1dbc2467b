"""Serves one site: takes views in, tells changes, answers queries, tells robots what is near them."""

import asyncio
import logging
import time
from asyncio import Task, TaskGroup
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from heapq import nlargest
from math import radians
from secrets import randbelow
from typing import Final
from uuid import uuid4

from bus import LATEST, Bus, Publisher, QoS, RefusedError, Reply, Request, Sample
from bus.reporting import report
from schemas import codec, keys
from schemas.distances import CameraView
from schemas.errors import SchemaError
from schemas.keys import NEARBY, RobotStreamKey, Stream
from schemas.worker_keys import WorldStream, world_key
from schemas.world import (
    MAX_CHANGES,
    MAX_PROBLEMS,
    FloorLooks,
    NearbyObjects,
    RobotOffset,
    SiteStatus,
    WorldAnswer,
    WorldChange,
    WorldChanges,
    WorldRequest,
)
from services.worldmodel.floor import Floor
from services.worldmodel.model import SiteModel
from services.worldmodel.name_limits import CameraName, LeftOutCounts, NameLimit
from services.worldmodel.object_lifecycle import Rules
from services.worldmodel.offsets import Localisation
from services.worldmodel.published_objects import PublishedObjects
from services.worldmodel.settings import WorldSettings
from services.worldmodel.state import RUNS, StateError, restored, saved

APART_NS: Final = 5_000_000_000
"""A view with a stamp that is farther from when it came is taken to be taken when it came: clocks are apart."""

SET_BACK_NS: Final = 1_000_000_000
"""A clock that goes back by more was set; by less it is put right in passing."""

REPLACED: Final = "views replaced by newer ones"
MALFORMED: Final = "malformed views"
OTHER_FRAME: Final = "views in another frame than the site's"
CLOCKS_APART: Final = "views whose stamps are far from when they came, taken as of then"
FAILED: Final = "of views that could not be taken in, see the log"


class ViewReader:
    """Decodes views. frame: of the site's map. name_limit: whose views there is room for.

    elsewhere: robots of other sites, whose views are none of this one's. left_out: counts, by robot and reason.
    """

    def __init__(self, frame: str, name_limit: NameLimit, elsewhere: Collection[str] = ()) -> None:
        self._frame = frame
        self._name_limit = name_limit
        self._elsewhere = elsewhere
        self.left_out = LeftOutCounts()

    def read(self, samples: Sequence[Sample]) -> list[tuple[CameraView, int]]:
        """Return the views of some samples, each with when it was taken, in that order."""
        found = [each for each in map(self._read, samples) if each is not None]
        return sorted(found, key=lambda each: each[1])

    def _read(self, sample: Sample) -> tuple[CameraView, int] | None:
        robot = ""
        try:
            camera = keys.parse_stream(sample.key).camera
            robot = camera.robot
            if robot in self._elsewhere:
                return None
            if sample.replaced:
                self.left_out.add(robot, REPLACED, sample.replaced)
            view = codec.decode(CameraView, sample.payload, sample.encoding)
            codec.check_identity(view.header, camera)
        except SchemaError as error:
            if self.left_out.add(robot, MALFORMED):
                log.warning("%s left out, as are later ones of its robot: %s", sample.key, error)
            return None
        if view.frame_id != self._frame:
            self.left_out.add(robot, OTHER_FRAME)
            return None
        full = self._name_limit.admit(robot, camera.camera, sample.received_ns)
        if full:
            self.left_out.add(robot, full)
            return None
        stamp_ns = view.header.stamp_ns
        if abs(sample.received_ns - stamp_ns) > APART_NS:
            self.left_out.add(robot, CLOCKS_APART)
            stamp_ns = sample.received_ns
        return view, stamp_ns


log = logging.getLogger(__name__)

AT_ONCE: Final = 48
"""Views that are taken in together. Of each camera only the newest waits, so a backlog lasts a moment."""

KEPT: Final = 100
STATE_S: Final = 2.0
KEEP_EVERY: Final = 5
"""Every n-th state is kept in a file."""

REFRESH_S: Final = 1.0
DRIFT_SAFETY_FACTOR: Final = 1.4
"""Factor on --drift-m and --drift-deg, because users' estimates are often too low."""


class Site:
    """One site's model on the bus. saved_state: of the worker that served it before; nothing to start empty."""

    def __init__(self, bus: Bus, settings: WorldSettings, name: str, saved_state: bytes = b"") -> None:
        self._bus = bus
        self._settings = settings
        self._name = name
        usual = Localisation(settings.drift_m * DRIFT_SAFETY_FACTOR, radians(settings.drift_deg) * DRIFT_SAFETY_FACTOR)
        self.model = SiteModel(Rules(localisation=usual, most_objects=settings.most_objects))
        prefix, self._last = uuid4().hex[:6], 0
        if saved_state:
            try:
                prefix, self._last = restored(name, saved_state, self.model, randbelow(RUNS))
                self.model.set_back(time.time_ns())  # its clock may have been ahead
            except StateError as error:
                log.warning("site %s: its state cannot be used (%s); starting with an empty site", name, error)
        self._published = PublishedObjects(name, prefix, self.model)
        self._epoch = uuid4().hex[:12]
        self._floor = Floor()
        self._name_limit = NameLimit((camera for camera, _ in self.model.cameras.items()), time.time_ns())
        self._reader = ViewReader(settings.frame, self._name_limit, settings.elsewhere(name))
        self._nearby: dict[str, Task[None]] = {}
        self._failed: set[str] = set()
        self._lag_ns = 0
        self._now_ns = 0

    def state(self) -> bytes:
        """Return what another worker goes on with."""
        return saved(self._name, self._published.prefix, self._last, self.model)

    async def run(self, keep: Callable[[bytes], None] = lambda _: None) -> None:
        """Serve the site until cancelled. keep: called with the state now and then."""
        changes = world_key(self._name, WorldStream.CHANGES)
        state = world_key(self._name, WorldStream.STATE)
        async with (
            self._bus.publisher(changes, QoS.RESULT, encoding=codec.encoding(WorldChanges), kept=KEPT) as told,
            self._bus.publisher(state, QoS.RESULT) as states,
            self._bus.serve(world_key(self._name, WorldStream.OBJECTS), self._answer),
            self._bus.serve(world_key(self._name, WorldStream.FLOOR), self._answer_floor),
            TaskGroup() as group,
        ):
            group.create_task(report(self._bus, world_key(self._name, WorldStream.STATUS), SiteStatus, self._status))
            group.create_task(self._refresh(told))
            group.create_task(self._keep_state(states, keep))
            for robot in self._settings.robots_of[self._name] or ("*",):
                group.create_task(self._receive(f"fleet/{robot}/*/{Stream.VIEW}", told, group))

    async def _receive(self, views: str, told: Publisher, group: TaskGroup) -> None:
        async with self._bus.subscribe(views, LATEST, history=False) as samples:
            async for batch in samples.batches(AT_ONCE):
                self._heed_clock(now_ns := time.time_ns())
                self._lag_ns = max(0, now_ns - batch[0].received_ns)
                found = self._reader.read(batch)
                self._forget(*self._name_limit.take_left())
                usual = [each for each in found if each[0].header.robot not in self._failed]
                for some in (usual, *([each] for each in found if each[0].header.robot in self._failed)):
                    self._take(told, some)
                for robot in {view.header.robot for view, _ in found} - self._nearby.keys():
                    self._nearby[robot] = group.create_task(self._tell_nearby(robot))
                await asyncio.sleep(0)

    def _take(self, told: Publisher, views: Sequence[tuple[CameraView, int]]) -> None:
        """Take views in, and tell what changed.

        A view that raises an unexpected error does not cost the others: they are then taken one by one, and so are all
        later ones of the robot whose view it was.
        """
        try:
            try:
                self.model.take_all(views)
            finally:  # what changed before it failed has changed
                self._tell(told, [self._published.change(event) for event in self.model.lifecycle.events])
            for view, at_ns in views:
                if self.model.trusts(view.header.robot):  # a lost one looked at floor elsewhere
                    self._floor.take(view, at_ns)
        except Exception:
            if len(views) != 1:
                for each in views:
                    self._take(told, [each])
                return
            ((view, _),) = views
            robot = view.header.robot
            self.model.left_out[robot, FAILED] += max(1, len(view.objects))
            if robot not in self._failed:
                self._failed.add(robot)
                log.exception("a view of %s left out, as are later ones like it", robot)

    def _heed_clock(self, now_ns: int) -> None:
        """Notice that the system clock was set back: until it were as late again, nothing would be new."""
        if now_ns < self._now_ns - SET_BACK_NS:
            log.warning("the clock was set back by %.0f s", (self._now_ns - now_ns) / 1e9)
            for each in (self.model, self._floor, self._name_limit):
                each.set_back(now_ns)
        self._now_ns = now_ns

    def _forget(self, robots: Sequence[str], cameras: Sequence[CameraName]) -> None:
        if cameras:
            self.model.forget(set(robots), cameras)
            self._floor.forget(cameras)
        self._failed.difference_update(robots)
        self._reader.left_out.forget(robots)
        for robot in robots:
            if robot in self._nearby:
                self._nearby.pop(robot).cancel()

    def _tell(self, told: Publisher, changes: list[WorldChange]) -> None:
        for start in range(0, len(changes), MAX_CHANGES):
            some = changes[start : start + MAX_CHANGES]
            message = WorldChanges(
                site=self._name, epoch=self._epoch, first=self._last + 1, sent_ns=time.time_ns(), changes=some
            )
            self._last += len(some)
            told.put(codec.encode(message))

    async def _refresh(self, told: Publisher) -> None:
        every_ns = int(self._settings.refresh_s * 1e9)
        while True:
            await asyncio.sleep(REFRESH_S)
            self._tell(told, self._published.refreshed(time.time_ns(), every_ns))

    async def _keep_state(self, states: Publisher, keep: Callable[[bytes], None]) -> None:
        due = 0
        while True:
            await asyncio.sleep(STATE_S)
            due += 1
            if states.wanted or due >= KEEP_EVERY:
                state = self.state()
                states.put(state)
                if due >= KEEP_EVERY:
                    keep(state)
                    due = 0

    async def _tell_nearby(self, robot: str) -> None:
        settings = self._settings
        key = str(RobotStreamKey(robot, NEARBY))
        async with self._bus.publisher(key, QoS.RESULT, encoding=codec.encoding(NearbyObjects)) as publisher:
            while True:
                await asyncio.sleep(1 / settings.nearby_hz)
                if publisher.wanted:
                    now_ns = time.time_ns()
                    since_ns = now_ns - int(settings.nearby_s * 1e9)
                    message = NearbyObjects(
                        robot=robot,
                        site=self._name,
                        frame_id=settings.frame,
                        sent_ns=now_ns,
                        radius_m=settings.nearby_m,
                        objects=self._published.nearby(robot, settings.nearby_m, since_ns),
                    )
                    publisher.put(codec.encode(message))

    async def _answer(self, request: Request) -> Reply:
        try:
            asked = codec.decode(WorldRequest, request.payload, request.encoding) if request.payload else WorldRequest()
        except SchemaError as error:
            raise RefusedError(str(error)) from error
        now_ns = time.time_ns()
        objects, complete = self._published.matching(asked, now_ns)
        answer = WorldAnswer(
            site=self._name, epoch=self._epoch, last=self._last, now_ns=now_ns, objects=objects, complete=complete
        )
        return Reply(codec.encode(answer), codec.encoding(WorldAnswer))

    async def _answer_floor(self, _: Request) -> Reply:
        return Reply(codec.encode(self._floor.message(self._name, time.time_ns())), codec.encoding(FloorLooks))

    def _status(self) -> SiteStatus:
        model, robots = self.model, self._published.robots()
        return SiteStatus(
            site=self._name,
            epoch=self._epoch,
            worker=self._settings.worker,
            sent_ns=time.time_ns(),
            last=self._last,
            objects=self._published.counts(),
            tentative=int((model.objects.number >= 0).sum() - model.objects.confirmed.sum()),
            views=model.views,
            sightings=model.sightings,
            left_out=self._left_out(),
            lag_ns=self._lag_ns,
            robots=robots,
            problems=self._problems(robots),
        )

    def _left_out(self) -> dict[str, int]:
        counts = Counter(self._reader.left_out.by_reason)
        for (_, reason), count in self.model.left_out.items():
            counts[reason] += count
        return dict(counts)

    def _problems(self, robots: Sequence[RobotOffset]) -> list[str]:
        doubted = [f"{each.robot}: {each.doubted}" for each in robots if each.doubted]
        left_out = (*self._reader.left_out.items(), *self.model.left_out.items())
        named = (each for each in left_out if each[0][0] and each[0][1] != REPLACED and each[1])
        worst = nlargest(MAX_PROBLEMS, named, key=lambda each: each[1])
        # in one form, those of views too: others find the robot by it
        others = (f"{robot}: {count} sightings left out: {why}" for (robot, why), count in worst)
        return [*doubted, *others][:MAX_PROBLEMS]


def site_key(name: str) -> keys.CameraKey:
    """Return the key under which workers share a site, as they do cameras."""
    return keys.CameraKey(name, "world")
