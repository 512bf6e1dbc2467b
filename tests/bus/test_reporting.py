import asyncio

from bus import QUEUE
from bus.fake import FakeNetwork
from bus.reporting import report
from schemas import codec, worker_keys
from schemas.status import WorkerStatus


async def test_a_status_comes_at_once_and_a_last_one_at_the_end() -> None:
    network, said, key = FakeNetwork(), iter(range(9)), worker_keys.worker_status("distance", "w")

    def status() -> WorkerStatus:
        return WorkerStatus(service="distance", worker="w", model="", sent_ns=next(said), cameras=[])

    numbers = []
    async with (
        network.open_bus() as ours,
        network.open_bus() as theirs,
        theirs.subscribe(key, QUEUE(4), history=False) as samples,
    ):
        reporting = asyncio.create_task(report(ours, key, WorkerStatus, status))
        for _ in range(2):
            sample = await anext(samples)
            numbers.append(codec.decode(WorkerStatus, sample.payload, sample.encoding).sent_ns)
            reporting.cancel()
        await asyncio.wait([reporting])
    assert numbers == [0, 1]
