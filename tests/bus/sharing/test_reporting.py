import asyncio

from bus import QUEUE
from bus.fake import FakeNetwork
from bus.shared_demand import SharedDemand
from bus.sharing.reporting import report, say_unwanted
from schemas import codec, worker_keys
from schemas.status import WorkerStatus


async def test_a_status_comes_at_once_and_a_last_one_at_the_end() -> None:
    network, said = FakeNetwork(), iter(range(9))

    def status() -> WorkerStatus:
        return WorkerStatus(service="distance", worker="w", model="", sent_ns=next(said), cameras=[])

    numbers = []
    async with (
        network.open_bus() as ours,
        network.open_bus() as theirs,
        theirs.subscribe(worker_keys.worker_status("distance", "w"), QUEUE(4), history=False) as samples,
    ):
        reporting = asyncio.create_task(report(ours, "distance", "w", status))
        for _ in range(2):
            sample = await anext(samples)
            numbers.append(codec.decode(WorkerStatus, sample.payload, sample.encoding).sent_ns)
            reporting.cancel()
        await asyncio.wait([reporting])
    assert numbers == [0, 1]


async def test_a_camera_is_taken_over_without_results_only_where_none_are_wanted() -> None:
    demand, taken = SharedDemand(), asyncio.Event()
    want = demand.of("distances")
    want(True)  # noqa: FBT003 - the bus calls it so
    saying = asyncio.create_task(say_unwanted(demand, taken.set))
    await asyncio.sleep(0)
    assert not taken.is_set()
    want(False)  # noqa: FBT003
    await saying
    assert taken.is_set()
