"""Presence of a thousand caches that never answer, as somebody could show it: cameras are heard all the same."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Final

import pytest
import zenoh
from zenoh.handlers import Callback

from bus import QUEUE, QoS, open_bus
from bus.history.caches import ASKED_AT_ONCE
from tests.bus.sessions import client, router
from tests.contract.conftest import free_endpoint
from tests.waiting import next_of, until

CACHES: Final = 1_000


@contextmanager
def silent_caches(endpoint: str) -> Iterator[list[zenoh.Query]]:
    """Show caches of as many cameras, and keep what they are asked without an answer."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    asked: list[zenoh.Query] = []
    with ExitStack() as stack:
        session = stack.enter_context(zenoh.open(config))
        stack.callback(asked.clear)
        session.declare_queryable("fleet/r0/*/classes/@adv/**", Callback(asked.append, indirect=False))
        keys = [f"fleet/r0/c{number}/classes/@adv/pub/1/1/_" for number in range(CACHES)]
        tokens = [session.liveliness().declare_token(key) for key in keys]
        yield asked
        for token in tokens:
            token.undeclare()


@pytest.mark.timeout(180)
async def test_a_thousand_caches_that_never_answer_keep_no_camera_from_being_heard() -> None:
    endpoint = free_endpoint()
    async with (
        open_bus(router(endpoint)),
        open_bus(client(endpoint)) as there,
        open_bus(client(endpoint)) as here,
        there.publisher("fleet/r1/front/classes", QoS.RESULT, kept=9) as honest,
        there.publisher("fleet/r0/c0/classes", QoS.RESULT, kept=9) as attacked,
    ):
        honest.put(b"kept")
        with silent_caches(endpoint) as asked:
            async with here.subscribe("fleet/*/*/classes", QUEUE(99), recover=100) as lists:
                await until(lambda: asked)
                honest.put(b"live")
                attacked.put(b"seen")
                heard = [(await next_of(lists)).payload for _ in range(3)]
                await until(lambda: len(asked) > 2 * ASKED_AT_ONCE)
    assert heard.index(b"kept") < heard.index(b"live")
    assert set(heard) == {b"kept", b"live", b"seen"}
