"""A site's model as messages: its objects, their changes, and the objects near a robot. Pure."""

from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.world import (
    MAX_CHANGES,
    MAX_OBJECTS,
    MAX_ROBOTS,
    ChangeKind,
    RobotOffset,
    Seer,
    WorldChange,
    WorldObject,
    WorldRequest,
)
from services.geometry.boxes import is_itself
from services.worldmodel.events import Event
from services.worldmodel.model import SiteModel
from services.worldmodel.offsets import REASONS, RIGHT

Rows = NDArray[np.intp]

STILL_M_S: Final = 0.1
BASE: Final = 36
_DIGITS: Final = "0123456789abcdefghijklmnopqrstuvwxyz"


class PublishedObjects:
    """Turns rows of a model into messages. site: its name. prefix: of ids, another one for each model begun anew."""

    def __init__(self, site: str, prefix: str, model: SiteModel) -> None:
        self.site = site
        self.prefix = prefix
        self.model = model

    def id_of(self, number: int) -> str:
        """Return the id of an object's number."""
        return f"{self.prefix}-{_short(number)}"

    def object(self, row: int, number: int | None = None) -> WorldObject:
        """Return the object of a row; number: of its id, where the row is free already."""
        model, objects = self.model, self.model.objects
        x, y = objects.centre[row].tolist()
        low, high = float(objects.low[row]), float(objects.high[row])
        vx, vy = objects.velocity[row].tolist()
        moves = bool(model.classes.moves[objects.cls[row]])
        xx, xy, yy = (float(objects.covariance[row][each]) for each in ((0, 0), (0, 1), (1, 1)))
        zz = float(objects.low_variance[row] + objects.high_variance[row]) / 4
        return WorldObject(
            id=self.id_of(int(objects.number[row]) if number is None else number),
            site=self.site,
            name=model.classes.names[int(objects.cls[row])],
            at=(x, y, (low + high) / 2),
            covariance=(xx, xy, 0.0, yy, 0.0, zz),
            size=(float(objects.size[row, 0]), float(objects.size[row, 1]), max(high - low, 0.0)),
            yaw=_half_turn(float(objects.yaw[row])),
            existence=float(1 / (1 + np.exp(-objects.logit[row]))),
            first_ns=int(objects.first_ns[row]),
            last_ns=int(objects.last_ns[row]),
            looked_ns=int(objects.looked_ns[row]) if objects.looked_ns[row] > objects.last_ns[row] else 0,
            seen_by=self._seers(row),
            sightings=int(objects.hits[row]),
            velocity=(vx, vy) if moves else None,
        )

    def _seers(self, row: int) -> list[Seer]:
        objects, names = self.model.objects, self.model.cameras.names
        known = zip(objects.seers_ns[row].tolist(), objects.seers[row].tolist(), strict=True)
        return [
            Seer(robot=names[camera][0], camera=names[camera][1], last_ns=last_ns)
            for last_ns, camera in sorted(known, reverse=True)
            if camera >= 0
        ]

    def change(self, event: Event) -> WorldChange:
        """Return an event as others are told of it."""
        return WorldChange(
            kind=event.kind,
            at_ns=event.at_ns,
            object=self.object(event.row, event.number),
            before=event.before,
            into=None if event.into is None else self.id_of(event.into),
            by=self.model.robots.names[event.robot],
        )

    def refreshed(self, now_ns: int, every_ns: int) -> list[WorldChange]:
        """Return the objects that were seen since they were last told, which was long ago; they count as told now."""
        objects = self.model.objects
        rows = objects.told_to_others()
        due = (objects.told_ns[rows] < now_ns - every_ns) & (objects.last_ns[rows] > objects.told_ns[rows])
        rows = rows[due][:MAX_CHANGES]
        objects.told_ns[rows] = now_ns
        return [
            WorldChange(kind=ChangeKind.SEEN, at_ns=int(objects.last_ns[row]), object=self.object(row))
            for row in rows.tolist()
        ]

    def matching(self, asked: WorldRequest, now_ns: int) -> tuple[list[WorldObject], bool]:
        """Return the objects that were asked for, by class and id, and whether these are all."""
        objects, rows = self.model.objects, self.model.objects.told_to_others()
        age_s = (now_ns - objects.last_ns[rows]) / 1e9
        kept = np.ones(len(rows), np.bool_)
        if asked.name:
            names = self.model.classes.names
            kept &= objects.cls[rows] == (names.index(asked.name) if asked.name in names else -1)
        if asked.region:
            kept &= inside(objects.centre[rows], asked.region)
        if asked.seen_within_s is not None:
            kept &= age_s <= asked.seen_within_s
        if asked.unseen_for_s is not None:
            kept &= age_s >= asked.unseen_for_s
        kept &= 1 / (1 + np.exp(-objects.logit[rows])) >= asked.least_existence
        if asked.robot:
            seers = [number for (robot, _), number in self.model.cameras.items() if robot == asked.robot]
            kept &= np.isin(objects.seers[rows], seers).any(axis=1)
        found = sorted((self.object(row) for row in rows[kept].tolist()), key=lambda each: (each.name, each.id))
        return found[:MAX_OBJECTS], len(found) <= MAX_OBJECTS

    def nearby(self, robot: str, radius_m: float, since_ns: int) -> list[WorldObject]:
        """Return the confirmed objects near a robot that were seen since then, nearest first.

        An object that moves, stands where the robot does, and is seen only by others is the robot itself.
        """
        model = self.model
        number = model.robots.find(robot)
        if number is None or not model.offsets.views[number]:
            return []
        at = model.offsets.position[number, :2]
        _, rows = model.index.within(at[np.newaxis] - radius_m, at[np.newaxis] + radius_m)
        rows = rows[model.objects.confirmed[rows] & (model.objects.last_ns[rows] >= since_ns)]
        away = np.hypot(*(model.objects.centre[rows] - at).T)
        nearest = rows[np.argsort(away)][: int((away <= radius_m).sum())]
        found = (self.object(row) for row in nearest.tolist())
        return list(islice((each for each in found if not is_itself(each, robot, at.tolist())), MAX_CHANGES))

    def robots(self) -> list[RobotOffset]:
        """Return how far each robot's localisation is off."""
        offsets = self.model.offsets
        return [
            RobotOffset(
                robot=name,
                x=float(offsets.state[number, 0]),
                y=float(offsets.state[number, 1]),
                yaw=float(offsets.state[number, 2]),
                sigma_m=float(np.sqrt(max(offsets.covariance[number, 0, 0], offsets.covariance[number, 1, 1]))),
                doubted=REASONS[int(offsets.doubted[number])],
                views=int(offsets.views[number]),
                last_ns=int(offsets.at_ns[number]),
            )
            for name, number in islice(self.model.robots.items(), min(MAX_ROBOTS, len(offsets.state)))
            if offsets.views[number] or offsets.doubted[number] != RIGHT  # others were there before a restart
        ]

    def counts(self) -> dict[str, int]:
        """Return how many confirmed objects of each class there are."""
        objects, names = self.model.objects, self.model.classes.names
        counts = np.bincount(objects.cls[objects.told_to_others()], minlength=len(names)).tolist()
        return {name: count for name, count in zip(names, counts, strict=True) if count}


def inside(points: NDArray[np.float64], corners: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """Return which points (n, 2) are in a polygon."""
    found = np.zeros(len(points), np.bool_)
    x, y = points.T
    for (x1, y1), (x2, y2) in _edges(corners):
        crosses = (y1 > y) != (y2 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            found ^= crosses & (x < (x2 - x1) * (y - y1) / (y2 - y1) + x1)
    return found


def _edges(
    corners: Sequence[tuple[float, float]],
) -> Iterable[tuple[tuple[float, float], tuple[float, float]]]:
    return zip(corners, [*corners[1:], corners[0]], strict=True)


def _half_turn(yaw: float) -> float:
    return (yaw + np.pi / 2) % np.pi - np.pi / 2


def _short(number: int) -> str:
    digits = ""
    while number >= BASE:
        number, digit = divmod(number, BASE)
        digits = _DIGITS[digit] + digits
    return _DIGITS[number] + digits
