"""Keys have numbers, of which a real session has 65,535."""

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from typing import Any, Final

import pytest
import zenoh

from bus import LATEST, QUEUE, Bus, QoS, open_bus
from bus.session import session as session_module
from bus.session.known_keys import AT_ONCE, MOST_KNOWN, KnownKeys
from tests.bus.sessions import client, router
from tests.contract.conftest import free_endpoint
from tests.waiting import next_of, until

NUMBERS: Final = 1 << 16
LEFT: Final = 60
AGAIN: Final = 2 * LEFT
FLEET: Final = 3 * AT_ONCE


@pytest.fixture
async def buses() -> AsyncIterator[tuple[Bus, Bus]]:
    """A router's bus, and a client's of it."""
    endpoint = free_endpoint()
    async with open_bus(router(endpoint)) as central, open_bus(client(endpoint)) as bus:
        yield central, bus


def session_of(bus: Any) -> Any:
    return bus._session._session


async def test_what_comes_and_goes_all_the_time_takes_no_number_from_what_stays(buses: tuple[Bus, Bus]) -> None:
    central, bus = buses
    async with AsyncExitStack() as stack:
        heard = await stack.enter_async_context(central.subscribe("fleet/**", QUEUE(99), history=False))
        keys = [f"fleet/r{number}/status" for number in range(20)]
        early = [await stack.enter_async_context(bus.publisher(key, QoS.STATUS)) for key in keys[:10]]
        session = session_of(bus)
        for number in range(NUMBERS - LEFT - 2 * len(keys)):
            session.undeclare(session.declare_keyexpr(f"spent/{number}"))
        for _ in range(AGAIN):
            async with bus.subscribe("overlay", LATEST):
                pass
        late = [await stack.enter_async_context(bus.publisher(key, QoS.STATUS)) for key in keys[10:]]
        for key, publisher in zip(keys, [*early, *late], strict=True):
            await until(lambda publisher=publisher: publisher.wanted)  # type: ignore[misc]
            publisher.put(key.encode())
        samples = [await next_of(heard) for _ in keys]
    assert {sample.key: sample.payload.decode() for sample in samples} == dict(zip(keys, keys, strict=True))


async def test_another_session_follows_that_of_a_client_with_many_declarations(
    buses: tuple[Bus, Bus], monkeypatch: pytest.MonkeyPatch
) -> None:
    central, bus = buses
    monkeypatch.setattr(session_module, "RENEWED_AFTER", 5)
    first = session_of(bus)
    async with central.subscribe("key", QUEUE(9)) as heard, bus.publisher("key", QoS.RESULT) as publisher:
        for number in range(5):
            async with bus.subscribe(f"other/{number}", LATEST):
                pass
        await until(lambda: session_of(bus) not in (None, first))
        publisher.put(b"still there")
        assert (await next_of(heard)).payload == b"still there"


async def test_another_session_follows_that_of_a_router_too_as_soon_as_it_can_listen(
    buses: tuple[Bus, Bus], monkeypatch: pytest.MonkeyPatch
) -> None:
    central, bus = buses
    monkeypatch.setattr(session_module, "OTHERS_RENEWED_AFTER", 5)
    opened, refusals = zenoh.open, iter([True])

    def refuse_once(config: zenoh.Config) -> zenoh.Session:
        if next(refusals, False):
            raise zenoh.ZError("the address is in use")
        return opened(config)

    first = session_of(central)
    async with bus.subscribe("key", QUEUE(9)) as heard, central.publisher("key", QoS.RESULT) as publisher:
        monkeypatch.setattr(zenoh, "open", refuse_once)
        for number in range(9):
            async with central.subscribe(f"other/{number}", LATEST):
                pass
        assert session_of(central) is first, "which took no number twice"
        for _ in range(5):
            async with central.publisher("latched", QoS.RESULT):
                pass
        await until(lambda: session_of(central) not in (None, first))
        await until(lambda: publisher.wanted and not bus.link_problem)
        publisher.put(b"still there")
        assert (await next_of(heard)).payload == b"still there"
    assert next(refusals, None) is None


async def test_a_client_is_told_the_keys_of_those_who_publish_what_it_subscribes_to(buses: tuple[Bus, Bus]) -> None:
    central, bus = buses
    keys = [f"fleet/r{number}/front/classes" for number in range(FLEET)]
    async with AsyncExitStack() as stack:
        for key in keys:
            await stack.enter_async_context(central.publisher(key, QoS.RESULT))
        async with bus.subscribe("fleet/*/*/classes", QUEUE(99)):
            await until(lambda: known_to(bus) == set(keys))
            assert known_to(central) == set()


def known_to(bus: Any) -> set[str]:
    return set() if bus._known_keys is None else set(bus._known_keys._known)


class Told:
    """Stands for a session that is told keys."""

    def __init__(self) -> None:
        self.keys: list[str] = []

    def declare_keyexpr(self, key: str) -> None:
        self.keys.append(key)


def test_keys_are_told_once_some_at_a_time_and_not_more_than_there_are_numbers_for() -> None:
    jobs: list[Any] = []
    session: Any = Told()
    known = KnownKeys(jobs.append)
    known.declare(session)
    for number in range(AT_ONCE + 1):
        known.add(f"{number}")
        known.add("0")
    assert len(jobs) == 1
    while jobs:
        before = len(session.keys)
        jobs.pop(0)()
        assert len(session.keys) - before <= AT_ONCE
    assert session.keys == [f"{number}" for number in range(AT_ONCE + 1)]
    for number in range(MOST_KNOWN + 9):
        known.add(f"{number}")
    while jobs:
        jobs.pop(0)()
    assert len(session.keys) == MOST_KNOWN
    known.undeclare()
    known.declare(session)
    known.add("0")
    while jobs:
        jobs.pop(0)()
    assert session.keys[-1:] == ["0"]
    assert len(session.keys) == MOST_KNOWN + 1
