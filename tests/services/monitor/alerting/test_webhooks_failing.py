"""Webhooks that fail at some posts and take others."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import msgspec
import pytest

from services.monitor.alerting.webhooks import GROUP, TRIES, Outcome
from services.monitor.rules.model import Webhook
from tests.schemas.results import alert
from tests.services.monitor.alerting.test_webhooks import SECRET, posting, receiving
from tests.waiting import until

Failing = Callable[[dict[str, Any]], bool]


class Choosy:
    """A receiver that answers what it fails at with an error, or not at all. got: the ids of each post's alerts."""

    def __init__(self, fails: Failing, error: bytes) -> None:
        self.fails = fails
        self.got: list[list[str]] = []
        self.taken: list[str] = []
        self._error = error

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode().lower()
        body = msgspec.json.decode(await reader.readexactly(int(head.split("content-length: ")[1].split("\r\n")[0])))
        ids = [each["id"] for each in body.get("alerts", [body])]
        self.got.append(ids)
        failed = self.fails(body)
        self.taken += [] if failed else ids
        writer.write(self._error if failed else b"HTTP/1.1 200 X\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
        await writer.drain()
        writer.close()


@asynccontextmanager
async def choosing(
    fails: Failing, error: bytes = b"HTTP/1.1 500 X\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
) -> AsyncIterator[tuple[Choosy, Webhook]]:
    receiver = Choosy(fails, error)
    async with await asyncio.start_server(receiver.serve, "127.0.0.1", 0) as server:
        port = server.sockets[0].getsockname()[1]
        yield receiver, Webhook.model_validate({"url": f"http://127.0.0.1:{port}/", "secret": SECRET})


def is_group(body: dict[str, Any]) -> bool:
    return "alerts" in body


@pytest.mark.parametrize("error", [b"HTTP/1.1 500 X\r\nContent-Length: 0\r\nConnection: close\r\n\r\n", b""])
async def test_one_that_fails_at_groups_is_told_of_each_alert_alone_and_a_group_is_tried_now_and_then(
    error: bytes,
) -> None:
    async with choosing(is_group, error) as (receiver, webhook), posting() as webhooks:
        webhooks.owe("ops", webhook, [alert(id_=f"a{number:03}") for number in range(GROUP + 9)])
        await until(lambda: webhooks.counts["ops", Outcome.DELIVERED] == GROUP + 9)
        assert receiver.taken == [f"a{number:03}" for number in range(GROUP + 9)], "in order"
        assert sum(len(post) > 1 for post in receiver.got) == 2
        assert not list(webhooks.owed())


async def test_one_that_was_down_and_fails_at_groups_is_told_of_what_waited() -> None:
    is_down = True
    async with choosing(lambda body: is_down or is_group(body)) as (receiver, webhook), posting() as webhooks:
        for number in range(3):
            webhooks.post("ops", webhook, alert(id_=f"a{number}"))
        await until(lambda: len(receiver.got) > TRIES + 3)
        is_down = False
        await until(lambda: webhooks.counts["ops", Outcome.DELIVERED] == 3)
        assert sorted(receiver.taken) == ["a0", "a1", "a2"]


async def test_one_that_was_down_for_long_still_gets_groups() -> None:
    is_down = True
    async with choosing(lambda _: is_down) as (receiver, webhook), posting() as webhooks:
        for number in range(2 * GROUP):
            webhooks.post("ops", webhook, alert(id_=f"a{number}"))
        await until(lambda: len(receiver.got) > TRIES + 9)
        is_down = False
        await until(lambda: webhooks.counts["ops", Outcome.DELIVERED] == 2 * GROUP)
        assert max(map(len, receiver.got[-2:])) > 1
        assert webhooks.counts == {("ops", Outcome.DELIVERED): 2 * GROUP}, "none is given up"


async def test_an_alert_that_always_fails_holds_up_no_other_and_is_given_up_once_others_were_taken() -> None:
    def fails(body: dict[str, Any]) -> bool:
        return any(each["id"] == "bad" for each in body.get("alerts", [body]))

    async with choosing(fails) as (receiver, webhook), posting() as webhooks:
        webhooks.post("ops", webhook, alert(id_="bad"))
        number = 0
        while not webhooks.counts["ops", Outcome.GIVEN_UP]:
            webhooks.post("ops", webhook, alert(id_=f"a{number}"))
            number += 1
            await until(lambda: len(receiver.taken) == number)  # noqa: B023 - awaited here
            tries = len(receiver.got)
            await until(lambda: len(receiver.got) > tries + 1 or not list(webhooks.owed()))  # noqa: B023
        assert number >= TRIES - 1
        webhooks.post("ops", webhook, alert(id_="next"))
        await until(lambda: receiver.taken[-1] == "next")
        assert "bad" not in receiver.taken


async def test_nothing_more_is_posted_to_a_webhook_that_is_gone_while_its_alert_is_tried_again() -> None:
    async with receiving(503) as (down, gone), receiving(200) as (up, webhook), posting() as webhooks:
        webhooks._first_wait_s = 0.1
        webhooks.post("gone", gone, alert())
        await until(lambda: len(down.got) == 1)
        webhooks.keep({"ops": webhook})
        webhooks.post("ops", webhook, alert())
        await until(lambda: len(up.got) == 1)
        await until(lambda: not webhooks._lanes["gone"].is_busy)
    assert len(down.got) == 1
