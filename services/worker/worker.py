"""The skeleton of every worker: shares cameras with its service's other workers, serves its own, reports status."""

import time
from asyncio import TaskGroup
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import msgspec

from bus.api import Bus, QoS
from bus.demand import SharedDemand, while_wanted
from bus.reporting import VERSION, report
from bus.sharing.sharing import JOIN_S, Sharing, say_unwanted
from bus.sharing.work_counts import Tallies, Tally
from schemas import codec
from schemas.keys import CameraKey, Stream
from schemas.status import WorkerStatus
from schemas.worker_keys import WorkerAlive, worker_status
from services import service_manager

T = TypeVar("T", bound=Tally)

ServeCamera = Callable[[CameraKey, T, Callable[[], None]], Awaitable[None]]
"""Serves a camera until cancelled. Counts its frames in the tally; calls the function once results arrive."""


def _no_details() -> Mapping[str, Any]:
    return {}


class Worker(Generic[T]):
    """One worker of a service.

    tokens: how it announces itself, see `SharingSettings.tokens`. tallies: one for each camera it serves. details:
    returns the fields of its status beside those that every worker fills in. pending, join_s: see
    `Sharing`. leaves: called when it begins to hand over.
    """

    def __init__(
        self,
        bus: Bus,
        tokens: Sequence[WorkerAlive],
        tallies: Tallies[T],
        serve: ServeCamera[T],
        *,
        details: Callable[[], Mapping[str, Any]] = _no_details,
        pending: Callable[[], object] = lambda: None,
        join_s: float = JOIN_S,
        leaves: Callable[[], None] = lambda: None,
    ) -> None:
        self._bus = bus
        self._service, self._name = tokens[0].service, tokens[0].worker
        self._tallies = tallies
        self._serve_camera = serve
        self._details = details
        self._sharing = Sharing(bus, tokens, Stream.COLOR, self._serve, pending=pending, join_s=join_s, leaves=leaves)

    async def run(self, *alongside: Coroutine[None, None, None]) -> None:
        """Work until cancelled; then hand over and end. alongside: runs as long as the worker does."""
        async with TaskGroup() as group:
            for coroutine in alongside:
                group.create_task(coroutine)
            key = worker_status(self._service, self._name)
            group.create_task(report(self._bus, key, WorkerStatus, self._status))
            group.create_task(service_manager.say_serving(lambda: self._bus.link_problem))
            await self._sharing.run()

    async def _serve(self, key: CameraKey, took_over: Callable[[], None]) -> None:
        with self._tallies.serving(key) as tally:
            await self._serve_camera(key, tally, took_over)

    def _status(self) -> WorkerStatus:
        status = WorkerStatus(
            service=self._service,
            worker=self._name,
            model="",
            sent_ns=time.time_ns(),
            cameras=self._tallies.loads(),
            version=VERSION,
        )
        return msgspec.structs.replace(status, **self._details())


@dataclass(frozen=True, slots=True)
class ResultStream:
    """A stream of results under a key. schema: of its messages."""

    key: str
    schema: type[msgspec.Struct]
    qos: QoS


async def publish_while_wanted(
    bus: Bus,
    streams: Sequence[ResultStream],
    work: Callable[..., Coroutine[None, None, None]],
    took_over: Callable[[], None],
) -> None:
    """Offer streams of results until cancelled; `work` runs while any of them has subscribers.

    work: called with the publisher of each stream, in that order. took_over: called, too, when nobody wants results for
    a while, since then none come that could show who serves.
    """
    demand = SharedDemand()
    async with AsyncExitStack() as stack, TaskGroup() as group:
        publishers = [
            await stack.enter_async_context(
                bus.publisher(each.key, each.qos, encoding=codec.encoding(each.schema), on_demand=demand.of(each.key))
            )
            for each in streams
        ]
        group.create_task(say_unwanted(demand, took_over))
        await while_wanted(demand, lambda: work(*publishers))
