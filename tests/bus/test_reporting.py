import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest

from bus import QUEUE, Subscription, reporting
from bus.fake import FakeNetwork
from bus.reporting import report
from schemas import worker_keys
from schemas.status import CameraLoad, WorkerStatus
from tests.waiting import receive

KEY = worker_keys.worker_status("distance", "w")
TOO_MUCH = CameraLoad(robot="r1", camera="front", inferred=2**64)


def status(sent_ns: int, *cameras: CameraLoad) -> WorkerStatus:
    return WorkerStatus(service="distance", worker="w", model="", sent_ns=sent_ns, cameras=list(cameras))


@asynccontextmanager
async def reported(said: Callable[[], WorkerStatus]) -> AsyncIterator[tuple[Subscription, asyncio.Task[None]]]:
    network = FakeNetwork()
    async with (
        network.open_bus() as ours,
        network.open_bus() as theirs,
        theirs.subscribe(KEY, QUEUE(4), history=False) as samples,
    ):
        reporting = asyncio.create_task(report(ours, KEY, WorkerStatus, said))
        yield samples, reporting
        reporting.cancel()
        await asyncio.wait([reporting])


async def test_a_status_comes_at_once_and_a_last_one_at_the_end() -> None:
    numbers = iter(range(9))
    async with reported(lambda: status(next(numbers))) as (samples, reporting):
        assert (await receive(samples, WorkerStatus)).sent_ns == 0
        reporting.cancel()
        assert (await receive(samples, WorkerStatus)).sent_ns == 1


async def test_a_status_that_cannot_be_sent_is_left_out_and_said_once(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reporting, "STATUS_PERIOD_S", 0)
    said = iter([status(1, TOO_MUCH), status(2, TOO_MUCH), status(3)])
    async with reported(lambda: next(said, status(4))) as (samples, _):
        assert (await receive(samples, WorkerStatus)).sent_ns == 3
    (line,) = [each for each in caplog.records if each.levelno == logging.ERROR]
    assert line.getMessage().startswith(f"{KEY}: status not sent: ")
