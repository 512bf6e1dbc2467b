"""The buses that the contract is held against: the fake, two peers, two clients of a router, one through a gateway.

The second of "robot" is a gateway that speaks alone for its robot, whose keys are those of the tests.
"""

import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from pathlib import Path
from typing import Protocol

import pytest
from blockbuster import blockbuster_ctx

from bus import Bus, BusSettings, open_bus
from bus.fake import FakeNetwork
from tests.bus.certificates import make_certificates
from tests.waiting import next_of


class Opener(Protocol):
    def __call__(self) -> AbstractAsyncContextManager[Bus]: ...


def free_endpoint() -> str:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{bound.getsockname()[1]}"


@pytest.fixture(autouse=True)
def _nothing_blocks_the_loop() -> Iterator[None]:
    with blockbuster_ctx("bus") as caught:
        caught.functions["os.stat"].can_block_in("bus/session/changed_files.py", "__init__")  # once, of certificates
        yield


@pytest.fixture(params=["fake", "peers", "router", "router-without-shm", "through-a-gateway", "robot"])
async def buses(request: pytest.FixtureRequest) -> AsyncIterator[tuple[Bus, Bus]]:
    """Two members of one network."""
    async with AsyncExitStack() as stack:
        if request.param == "fake":
            network = FakeNetwork()
            yield (
                await stack.enter_async_context(network.open_bus()),
                await stack.enter_async_context(network.open_bus()),
            )
            return
        endpoint = free_endpoint()
        if request.param == "peers":
            settings = [
                BusSettings(mode="peer", listen=[endpoint], connect=[]),
                BusSettings(mode="peer", connect=[endpoint]),
            ]
        else:
            shm = request.param == "router"
            await stack.enter_async_context(open_bus(BusSettings(mode="router", listen=[endpoint], shared_memory=shm)))
            settings = [BusSettings(connect=[endpoint], shared_memory=shm)] * 2
            if request.param == "through-a-gateway":
                near = free_endpoint()
                await stack.enter_async_context(
                    open_bus(BusSettings(connect=[endpoint], listen=[near], shared_memory=shm))
                )
                settings[0] = BusSettings(connect=[near], shared_memory=shm)
        prefix = ""
        if request.param == "robot":
            prefix = "fleet/r1"
            settings[1] = settings[1].model_copy(update={"listen": [free_endpoint()]})
        here = await stack.enter_async_context(open_bus(settings[0]))
        there = await stack.enter_async_context(open_bus(settings[1], prefix=prefix))
        await _meet(here, there)
        yield here, there


@pytest.fixture(params=["fake", "real"])
def opener(request: pytest.FixtureRequest) -> Opener:
    """A bus that is alone."""
    if request.param == "fake":
        return FakeNetwork().open_bus
    return lambda: open_bus(BusSettings(mode="router", listen=[free_endpoint()]))


@pytest.fixture(params=["fake", "real"])
def with_certificate(request: pytest.FixtureRequest, tmp_path: Path) -> AbstractAsyncContextManager[Bus]:
    """A bus that is alone, with the certificate of gpu1."""
    if request.param == "fake":
        return FakeNetwork().open_bus("gpu1")
    make_certificates(tmp_path)
    listen = [free_endpoint().replace("tcp/", "tls/")]
    return open_bus(BusSettings.model_validate({"mode": "router", "listen": listen, "tls": tmp_path / "gpu1"}))


async def _meet(here: Bus, there: Bus) -> None:
    """Wait until the two see each other."""
    async with here.announce("meeting"), there.watch("meeting") as watch:
        await next_of(watch)
