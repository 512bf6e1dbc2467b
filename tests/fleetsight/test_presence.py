"""Who is there, over real sessions."""

import asyncio
from contextlib import AsyncExitStack

import pytest

import fleetsight
from bus import BusSettings, open_bus
from fleetsight import Change, Fleet, WorkerName
from schemas import keys
from schemas.keys import CameraKey, Stream
from schemas.worker_keys import WorkerAlive
from tests.contract.conftest import free_endpoint
from tests.fleetsight.stand_in import FRONT, StandIn
from tests.waiting import PATIENCE_S, next_of, until


async def test_who_is_there_already_comes_first_and_then_who_comes_and_goes(there: StandIn, fleet: Fleet) -> None:
    changes = aiter(fleet.robots())
    assert await next_of(changes) == Change("r1", here=True)
    async with there.bus.announce(keys.robot_alive("r2")):
        assert await next_of(changes) == Change("r2", here=True)
    assert await next_of(changes) == Change("r2", here=False)


async def test_all_who_are_there(there: StandIn, fleet: Fleet) -> None:
    rear = CameraKey("s1", "rear")
    async with (
        there.bus.announce(rear.alive(Stream.COLOR)),
        there.bus.announce(rear.alive(Stream.DEPTH)),
        there.bus.announce(keys.robot_alive("s1")),
    ):
        assert await fleet.robots().present() == {"r1", "s1"}
        assert await fleet.cameras().present() == {FRONT, rear}
        assert await fleet.cameras(robot="s*").present() == {rear}
        assert await fleet.cameras(camera="back*").present() == set()


async def test_a_worker_for_several_robots_is_one(there: StandIn, fleet: Fleet) -> None:
    changes = aiter(fleet.workers("cloud"))
    tokens = [str(WorkerAlive("cloud", "c1", 1.0, robot)) for robot in ("r1", "r2")]
    async with there.bus.announce(tokens[0]):
        assert await next_of(changes) == Change(WorkerName("cloud", "c1"), here=True)
        async with there.bus.announce(tokens[1]):
            assert await fleet.workers().present() == {WorkerName("cloud", "c1"), WorkerName("detector", "w1")}
    assert await next_of(changes) == Change(WorkerName("cloud", "c1"), here=False)


async def test_what_is_no_presence_of_ours_is_left_out(there: StandIn, fleet: Fleet) -> None:
    async with there.bus.announce("fleet/-/alive"), there.bus.announce("fleet/r1/tf/color/alive"):
        assert await fleet.robots().present() == {"r1"}
        assert await fleet.cameras().present() == {FRONT}


async def test_a_fleet_that_was_left_says_so(there: StandIn) -> None:
    async with fleetsight.connect(there.endpoint) as fleet:
        pass
    with pytest.raises(fleetsight.ClosedError, match="robots: the fleet was left before"):
        await fleet.robots().present()


async def test_a_fleet_that_is_left_meanwhile_says_so_too(there: StandIn) -> None:
    async with fleetsight.connect(there.endpoint) as fleet:
        asking = asyncio.create_task(fleet.robots().present(settle_s=PATIENCE_S, within_s=PATIENCE_S))
        await fleet.cameras().present()
    with pytest.raises(fleetsight.ClosedError, match="robots: the fleet was left before"):
        await asking


async def test_without_a_link_nobody_knows_who_is_there() -> None:
    endpoint = free_endpoint()
    async with AsyncExitStack() as stack:
        async with open_bus(BusSettings(mode="router", listen=[endpoint])):
            fleet = await stack.enter_async_context(fleetsight.connect(endpoint))
            assert await fleet.robots().present() == set()
        await until(lambda: fleet.problem)
        with pytest.raises(fleetsight.ConnectError) as refusal:
            await fleet.robots().present()
    assert str(refusal.value) == (
        f"robots: there is no link to {endpoint}; wait until `fleet.problem` is empty, and see that the router runs"
    )


async def test_somebody_who_comes_and_goes_all_the_time_holds_nobody_up(there: StandIn, fleet: Fleet) -> None:
    async def blink() -> None:
        while True:
            async with there.bus.announce(keys.robot_alive("r2")):
                await asyncio.sleep(0.05)
            await asyncio.sleep(0.05)

    blinking = asyncio.create_task(blink())
    async with asyncio.timeout(PATIENCE_S):
        assert "r1" in await fleet.robots().present(settle_s=PATIENCE_S * 2, within_s=1.0)
        assert "r1" in await fleet.robots().present(settle_s=1.0)
    blinking.cancel()
    await asyncio.wait([blinking])


@pytest.mark.parametrize("given", [{"settle_s": 0}, {"settle_s": float("nan")}, {"within_s": -1}, {"within_s": "long"}])
async def test_a_time_that_cannot_be_is_refused_at_once(fleet: Fleet, given: dict[str, float]) -> None:
    with pytest.raises(fleetsight.SettingsError, match=f"^{next(iter(given))} "):
        await fleet.robots().present(**given)


def test_a_service_that_cannot_be_is_refused_at_once() -> None:
    with pytest.raises(fleetsight.SettingsError, match="service pattern"):
        Fleet.workers(None, "a/b")  # type: ignore[arg-type]
