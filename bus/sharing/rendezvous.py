"""Assigns cameras to workers by weighted rendezvous hashing. Pure."""

import math
from collections.abc import Collection
from hashlib import blake2b
from typing import Final

from schemas.keys import CameraKey
from schemas.worker_keys import WorkerAlive

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
