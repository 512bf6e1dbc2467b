"""Assigns cameras to workers: weighted rendezvous hashing over the workers that are present. Pure."""

import math
from collections import defaultdict
from collections.abc import Collection
from hashlib import blake2b
from typing import Final, TypeVar

from schemas.keys import CameraKey
from schemas.worker_keys import Serves, WorkerAlive

_BYTES: Final = 8


def owner(camera: CameraKey, workers: Collection[WorkerAlive]) -> str | None:
    """Return the worker that owns a camera: one for its robot, or else one for any robot."""
    bound = [worker for worker in workers if worker.robot == camera.robot]
    able = bound or [worker for worker in workers if worker.robot is None]
    return max(able, key=lambda worker: (_score(worker, camera), worker.worker)).worker if able else None


def _score(worker: WorkerAlive, camera: CameraKey) -> float:
    return -worker.weight / _log_uniform(worker.worker, camera)


def _log_uniform(worker: str, camera: CameraKey) -> float:
    """Return the logarithm of a pseudo-random number between 0 and 1, both excluded."""
    digest = blake2b(f"{worker}/{camera}".encode(), digest_size=_BYTES).digest()
    return math.log((int.from_bytes(digest) + 0.5) / (1 << 8 * _BYTES))


HAND_OVER_S: Final = 2.0
"""Time for which a worker still serves a camera that now belongs to another one, until that one takes over."""

T = TypeVar("T")

MAX_WORKERS: Final = 1_000
MAX_CAMERAS: Final = 10_000
MAX_TAKEN: Final = 2 * MAX_CAMERAS


class Shares:
    """One worker's share of the cameras.

    A camera that falls to another worker stays here until that one says that it has taken it over, or for HAND_OVER_S:
    a short overlap beats a gap. Results of the same frame twice have the same identity.
    """

    def __init__(self, worker: str) -> None:
        self._worker = worker
        self._workers: set[WorkerAlive] = set()
        self._cameras: dict[CameraKey, None] = {}
        self._owners: dict[CameraKey, str | None] = {}
        self._taken: defaultdict[CameraKey, set[str]] = defaultdict(set)
        self._taken_count = 0
        self._served: dict[CameraKey, float | None] = {}

    @property
    def serving(self) -> frozenset[CameraKey]:
        """The cameras to serve according to the last plan."""
        return frozenset(self._served)

    def worker(self, token: WorkerAlive, *, alive: bool) -> bool:
        """Note that a worker came or went; return whether that is new. Those over MAX_WORKERS are ignored."""
        news = _note(self._workers, token, alive=alive, limit=MAX_WORKERS)
        if news and alive:
            self._compare(token)
        elif news:
            self._owners = {camera: name for camera, name in self._owners.items() if name != token.worker}
        return news

    def camera(self, camera: CameraKey, *, alive: bool) -> bool:
        """Note that a camera came or went; return whether that is new. Those over MAX_CAMERAS are ignored."""
        if alive == (camera in self._cameras) or (alive and len(self._cameras) >= MAX_CAMERAS):
            return False
        if alive:
            self._cameras[camera] = None
        else:
            del self._cameras[camera]
            self._owners.pop(camera, None)
        return True

    def taken(self, token: Serves, *, alive: bool) -> bool:
        """Note that a worker took a camera over or released it; return whether that is new."""
        workers = self._taken[token.camera]
        news = _note(workers, token.worker, alive=alive, limit=len(workers) + MAX_TAKEN - self._taken_count)
        if news:
            self._taken_count += 1 if alive else -1
        if not workers:
            del self._taken[token.camera]
        return news

    def plan(self, now_s: float, most: int) -> frozenset[CameraKey]:
        """Return the cameras to serve from now on: at most `most`, those known longest first.

        now_s: any steady clock; a plan is good until `next_s`, or until there is news.
        """
        served: dict[CameraKey, float | None] = {}
        for camera in self._cameras:
            if len(served) >= most:
                break
            if camera not in self._owners:
                self._owners[camera] = owner(camera, self._workers)
            winner = self._owners[camera]
            if winner == self._worker:
                served[camera] = None
            elif winner is not None and camera in self._served:
                until_s = self._served[camera] or now_s + HAND_OVER_S
                if winner not in self._taken.get(camera, ()) and now_s < until_s:
                    served[camera] = until_s
        self._served = served
        return self.serving

    def _compare(self, joined: WorkerAlive) -> None:
        """Compare a worker that joined with the known owners; all other assignments stay."""
        tokens = defaultdict[str | None, list[WorkerAlive]](list)
        for each in self._workers:
            tokens[each.worker].append(each)
        self._owners = {camera: owner(camera, [joined, *tokens[name]]) for camera, name in self._owners.items()}

    @property
    def next_s(self) -> float | None:
        """When the plan changes by itself, on the clock given to `plan`; None if never."""
        return min((until_s for until_s in self._served.values() if until_s is not None), default=None)

    @property
    def handing_over(self) -> bool:
        """Whether a camera is still served that now belongs to another worker."""
        return self.next_s is not None


def _note(members: set[T], member: T, *, alive: bool, limit: int) -> bool:
    if alive == (member in members) or (alive and len(members) >= limit):
        return False
    (members.add if alive else members.discard)(member)
    return True
