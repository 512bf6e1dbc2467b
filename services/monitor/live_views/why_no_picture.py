"""Explains why a camera shows no picture, and what to do about it. Pure."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from schemas.keys import CameraKey, Stream
from schemas.status import WorkerStatus
from schemas.worker_keys import DETECTOR
from services.monitor.fleet import Fleet
from services.monitor.formats import natural

WAITING: Final = "Nothing has arrived yet"
MODEL_WARMING_UP: Final = "It has been requested; a model takes some seconds to warm up."
FIRST_FRAME_TIMEOUT_S: Final = 20.0
"""Seconds after which a model is warm, so that a missing stream has another cause."""

LATE: Final = "Nothing newer arrives"
OVERLOADED: Final = "Its worker or the link to it may be overloaded: Health shows what was dropped where."


@dataclass(frozen=True, slots=True)
class Reason:
    """A problem in a few words, and its cure."""

    title: str
    advice: str


@dataclass(frozen=True, slots=True)
class Facts:
    """The state of a camera. serving: workers of the service that serve it. workers: all that are online.

    came: something was shown before. waited_s: since it was asked for. deaf: why the monitor cannot hear the fleet.
    join: the endpoint that workers are to connect to.
    """

    known: bool
    robot_online: bool
    camera_online: bool
    serving: tuple[WorkerStatus, ...] = ()
    workers: tuple[WorkerStatus, ...] = ()
    came: bool = False
    waited_s: float = 0.0
    deaf: str = ""
    join: str = ""


def facts_of(
    fleet: Fleet, key: CameraKey, workers: Iterable[WorkerStatus], *, came: bool, waited_s: float, deaf: str, join: str
) -> Facts:
    """Return the state of a camera. workers: those of the service that are online. See `Facts`."""
    there = tuple(workers)
    return Facts(
        known=fleet.inventory.camera(key) is not None,
        robot_online=fleet.inventory.is_alive(key.robot),
        camera_online=fleet.inventory.online(key),
        serving=serving(key, there),
        workers=there,
        came=came,
        waited_s=waited_s,
        deaf=deaf,
        join=join,
    )


def serving(key: CameraKey, workers: Iterable[WorkerStatus]) -> tuple[WorkerStatus, ...]:
    """Return the workers that serve a camera now."""
    return tuple(
        worker
        for worker in workers
        if any((load.robot, load.camera) == (key.robot, key.camera) and load.serving for load in worker.cameras)
    )


def why_nothing(key: CameraKey, stream: Stream, service: str, facts: Facts) -> Reason:
    """Return the first reason, seen from this monitor, for a stream's absence; else that it is still starting."""
    if facts.deaf:
        return Reason(
            "This monitor has no link to the fleet",
            f"{facts.deaf}. The state of {key.robot} is unknown until it is back: check the network and the router "
            "between them.",
        )
    if not facts.known:
        return Reason(
            f"No camera {key} is known",
            "Check its name in the overview, or start its gateway: fleetsight gateway --robot " + key.robot,
        )
    if not facts.robot_online:
        return Reason(
            f"{key.robot} is offline",
            "Its gateway is gone: check that the robot is switched on, has network and runs its gateway.",
        )
    if not facts.camera_online:
        return Reason(
            f"{key.camera} is not published on {key.robot}",
            f"Its driver may be down. On the robot, fleetsight doctor --robot {key.robot} shows why.",
        )
    return _of_workers(key, stream, service, facts)


def _of_workers(key: CameraKey, stream: Stream, service: str, facts: Facts) -> Reason:
    if not facts.workers:
        return Reason(f"No {service} runs", f"Start one anywhere with fleetsight {service} --connect {facts.join}")
    waiting = [worker for worker in facts.workers if service == DETECTOR and not worker.model and worker.remarks]
    if waiting and len(waiting) == len(facts.workers):
        told = "; ".join(f"{worker.worker}: {worker.remarks[0]}" for worker in waiting[:3])
        return Reason(f"No {service} has a model yet", told)
    if not facts.serving:
        names = ", ".join(sorted((worker.worker for worker in facts.workers), key=natural)[:3])
        return Reason(
            f"No {service} serves {key}",
            f"{names} runs, but not for this robot: start one without --robots, or with --robots {key.robot}",
        )
    remarks = [remark for worker in facts.serving for remark in worker.remarks if str(stream) in remark]
    if remarks:
        return Reason("This model cannot do that", "; ".join(remarks))
    if facts.came:
        return Reason(LATE, OVERLOADED)
    return Reason(
        WAITING, MODEL_WARMING_UP if facts.waited_s < FIRST_FRAME_TIMEOUT_S else _lasting(key, service, facts)
    )


def _lasting(key: CameraKey, service: str, facts: Facts) -> str:
    names = ", ".join(sorted((worker.worker for worker in facts.serving), key=natural)[:3])
    return (
        f"It was requested {facts.waited_s:.0f} s ago. Check in Health that a {service} serves {key} without "
        f"dropping its images, and read the log of {names}."
    )
