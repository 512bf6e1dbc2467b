"""The owner of each camera among the workers that are present, by weighted rendezvous hashing. Pure."""

import math
from collections import defaultdict
from collections.abc import Collection
from hashlib import blake2b
from typing import Final

from schemas.keys import CameraKey
from schemas.status import MAX_STREAMS
from schemas.worker_keys import Serves, WorkerAlive

MAX_WORKERS: Final = 1_000
MAX_CAMERAS: Final = 10_000
MAX_TAKEN: Final = 10 * MAX_CAMERAS
"""Tokens for cameras taken over that are kept, of each worker as many as it can serve at most. Of more, those of
workers that are not present give way, else of the one that has most. A worker whose token is not kept counts as idle: a
camera is served twice rather than not at all."""

TAKE_OVER_S: Final = 2.0
"""A worker that has served a camera for so long says that it has taken it over, whether results came or not."""

IDLE_S: Final = 3.0
"""Time after which a worker that has not taken over a camera of its own is passed over for that camera."""


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


class CameraAssignment:
    """The owner of each camera: the worker that rendezvous hashing gives it to, unless that one leaves it idle.

    A worker says with a token that it has taken a camera over, at the latest TAKE_OVER_S after it began to serve it.
    One that is present and does not take a camera over, since it is at its limit or only a token, loses it to the next
    one after IDLE_S. It gets the camera back as soon as it shows that token. Next are those that have taken over any
    camera, and the worker that looks: many that are only tokens would otherwise take IDLE_S each.

    me: the worker that looks; it never passes over itself.
    """

    def __init__(self, me: str) -> None:
        self._me = me
        self._workers: set[WorkerAlive] = set()
        self._taken: defaultdict[CameraKey, set[str]] = defaultdict(set)
        self._taken_count = 0
        self._serving: defaultdict[str, dict[CameraKey, None]] = defaultdict(dict)
        self._owners: dict[CameraKey, str | None] = {}
        self._idle_since_s: dict[CameraKey, float] = {}
        self._passed: dict[CameraKey, set[str]] = {}

    def worker(self, token: WorkerAlive, *, alive: bool) -> bool:
        """Note that a worker came or went; return whether that is new. Others over MAX_WORKERS are ignored."""
        full = len(self._workers) >= MAX_WORKERS and token.worker != self._me
        if (token in self._workers) == alive or (alive and full):
            return False
        if alive:
            self._workers.add(token)
            self._compare(token)
        else:
            self._workers.remove(token)
            for camera, name in list(self._owners.items()):
                if name == token.worker:
                    self._forget_owner(camera)
            for camera in [camera for camera, passed in self._passed.items() if token.worker in passed]:
                self._trust(camera, token.worker)
        return True

    def taken(self, token: Serves, *, alive: bool) -> bool:
        """Note that a worker took a camera over or released it; return whether that is new."""
        if (token.worker in self._taken.get(token.camera, ())) == alive:
            return False
        if not alive:
            self._release(token.camera, token.worker)
            return True
        if len(self._serving.get(token.worker, ())) >= MAX_STREAMS:
            return False
        if self._taken_count >= MAX_TAKEN and not self._make_room(token.worker):
            return False
        self._taken[token.camera].add(token.worker)
        self._taken_count += 1
        self._note_serving(token.worker, token.camera, serving=True)
        if token.worker in self._passed.get(token.camera, ()):
            self._trust(token.camera, token.worker)
        return True

    def _make_room(self, worker: str) -> bool:
        """Forget a token of another worker, if that one has less right to it; return whether there is room."""
        present = {each.worker for each in self._workers}
        if worker not in present:
            return False
        absent = (each for each in self._serving if each not in present)
        victim = next(absent, None) or max(self._serving, key=lambda each: len(self._serving[each]))
        self._release(next(iter(self._serving[victim])), victim)
        return True

    def _release(self, camera: CameraKey, worker: str) -> None:
        self._taken[camera].discard(worker)
        if not self._taken[camera]:
            del self._taken[camera]
        self._taken_count -= 1
        self._note_serving(worker, camera, serving=False)

    def took(self, camera: CameraKey) -> frozenset[str]:
        """Return the workers that have taken a camera over."""
        return frozenset(self._taken.get(camera, ()))

    def is_idle(self, camera: CameraKey, worker: str) -> bool:
        """Return whether a worker has not taken a camera over, as far as is known: see MAX_TAKEN."""
        return worker not in self._taken.get(camera, ())

    def owner(self, camera: CameraKey, now_s: float) -> str | None:
        """Return a camera's owner, None where no worker may serve it. now_s: any steady clock."""
        while True:
            if camera not in self._owners:
                self._owners[camera] = self._next(camera)
            found = self._owners[camera]
            if found is None or found == self._me or not self.is_idle(camera, found):
                self._idle_since_s.pop(camera, None)
                return found
            if now_s - self._idle_since_s.setdefault(camera, now_s) < IDLE_S:
                return found
            self._passed.setdefault(camera, set()).add(found)
            self._forget_owner(camera)

    def _next(self, camera: CameraKey) -> str | None:
        passed = self._passed.get(camera)
        if not passed:
            return owner(camera, self._workers)
        able = [each for each in self._workers if each.worker not in passed]
        serving = [each for each in able if each.worker in self._serving or each.worker == self._me]
        return owner(camera, serving) or owner(camera, able)

    def _note_serving(self, worker: str, camera: CameraKey, *, serving: bool) -> None:
        """Note which cameras a worker has taken over; with its first and last one it may be another's turn."""
        before = worker in self._serving
        if serving:
            self._serving[worker][camera] = None
        else:
            del self._serving[worker][camera]
            if not self._serving[worker]:
                del self._serving[worker]
        if before != (worker in self._serving):
            for passed in self._passed:
                if passed in self._owners and self._owners[passed] != self._next(passed):
                    self._forget_owner(passed)

    def forget(self, camera: CameraKey) -> None:
        """Forget a camera that went, but not who took it over."""
        self._forget_owner(camera)
        self._passed.pop(camera, None)

    @property
    def next_s(self) -> float | None:
        """When an owner changes by itself, on the clock given to `owner`; None if never."""
        return min(self._idle_since_s.values()) + IDLE_S if self._idle_since_s else None

    def _trust(self, camera: CameraKey, worker: str) -> None:
        self._passed[camera].discard(worker)
        if not self._passed[camera]:
            del self._passed[camera]
        self._forget_owner(camera)

    def _forget_owner(self, camera: CameraKey) -> None:
        self._owners.pop(camera, None)
        self._idle_since_s.pop(camera, None)

    def _compare(self, joined: WorkerAlive) -> None:
        """Compare a worker that joined with the known owners; all other assignments stay."""
        tokens = defaultdict[str | None, list[WorkerAlive]](list)
        for each in self._workers:
            tokens[each.worker].append(each)
        for camera, name in list(self._owners.items()):
            if joined.worker in self._passed.get(camera, ()):
                continue
            found = owner(camera, [joined, *tokens[name]])
            if found != name:
                self._forget_owner(camera)
                self._owners[camera] = found
