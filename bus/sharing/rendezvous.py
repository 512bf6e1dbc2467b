"""Weighted rendezvous hashing: whoever knows the same workers knows who looks after a camera. Pure.

Each worker has for each camera a number that depends on nothing else, and the greatest one wins: a worker that leaves
moves only its own cameras, one that joins only those that it wins. With -weight / ln(uniform) as the number a worker
wins its weight's share of all cameras (Schindelhauer and Schomaker, "Weighted distributed hash tables", 2005).
"""

import math
from collections.abc import Collection
from hashlib import blake2b
from typing import Final

from schemas.keys import CameraKey
from schemas.worker_keys import WorkerAlive

_BYTES: Final = 8


def owner(camera: CameraKey, workers: Collection[WorkerAlive]) -> str | None:
    """Return the worker that a camera falls to: one of those for its robot, or else one of those for any."""
    bound = [worker for worker in workers if worker.robot == camera.robot]
    able = bound or [worker for worker in workers if worker.robot is None]
    return max(able, key=lambda worker: (_score(worker, camera), worker.worker)).worker if able else None


def _score(worker: WorkerAlive, camera: CameraKey) -> float:
    return -worker.weight / _log_uniform(worker.worker, camera)


def _log_uniform(worker: str, camera: CameraKey) -> float:
    """Return the logarithm of a number that is as good as random, between 0 and 1 and neither of them."""
    digest = blake2b(f"{worker}/{camera}".encode(), digest_size=_BYTES).digest()
    return math.log((int.from_bytes(digest) + 0.5) / (1 << 8 * _BYTES))
