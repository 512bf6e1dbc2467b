import asyncio
import hashlib
import hmac
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from itertools import count

import msgspec
import pytest

from schemas.alerts import Alert, AlertState
from services.monitor.alerting import backlog
from services.monitor.alerting.webhooks import GROUP, TRIES, Outcome, Webhooks, signed
from services.monitor.rules.model import Webhook
from tests.schemas.results import alert
from tests.waiting import until

SECRET = "a long secret"  # noqa: S105 - of a test


class Receiver:
    """An HTTP server that answers with these statuses in turn, the last one for ever, and keeps what it got."""

    def __init__(self, statuses: Sequence[int]) -> None:
        self.got: list[tuple[dict[str, str], bytes]] = []
        self._statuses = list(statuses)

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode().split("\r\n")[1:]
        headers = {name.lower(): value for name, _, value in (line.partition(": ") for line in head) if name}
        self.got.append((headers, await reader.readexactly(int(headers["content-length"]))))
        status = self._statuses.pop(0) if len(self._statuses) > 1 else self._statuses[0]
        writer.write(f"HTTP/1.1 {status} X\r\nContent-Length: 0\r\nConnection: close\r\n\r\n".encode())
        await writer.drain()
        writer.close()


@asynccontextmanager
async def receiving(*statuses: int) -> AsyncIterator[tuple[Receiver, Webhook]]:
    receiver = Receiver(statuses)
    server = await asyncio.start_server(receiver.serve, "127.0.0.1", 0)
    async with server:
        port = server.sockets[0].getsockname()[1]
        yield receiver, Webhook.model_validate({"url": f"http://127.0.0.1:{port}/hook", "secret": SECRET})


@asynccontextmanager
async def posting(now_s: Callable[[], float] = time.time) -> AsyncIterator[Webhooks]:
    webhooks = Webhooks(first_wait_s=0.001, now_s=now_s, down_wait_s=0.01, group_wait_s=0.01)
    running = asyncio.create_task(webhooks.run())
    try:
        yield webhooks
    finally:
        running.cancel()
        await asyncio.wait([running])


async def test_an_alert_is_posted_signed_and_in_order() -> None:
    async with receiving(200) as (receiver, webhook), posting() as webhooks:
        for number in range(3):
            webhooks.post("ops", webhook, alert(id_=f"a{number}"))
        await until(lambda: len(receiver.got) == 3)
    assert [msgspec.json.decode(body, type=Alert).id for _, body in receiver.got] == ["a0", "a1", "a2"]
    headers, body = receiver.got[0]
    expected = hmac.new(SECRET.encode(), headers["x-fleetsight-timestamp"].encode() + b"." + body, hashlib.sha256)
    assert headers["x-fleetsight-signature"] == f"sha256={expected.hexdigest()}"
    assert headers["content-type"] == "application/json"


async def test_it_is_tried_again_with_the_same_delivery_id() -> None:
    async with receiving(500, 429, 204) as (receiver, webhook), posting() as webhooks:
        webhooks.post("ops", webhook, alert())
        await until(lambda: len(receiver.got) == 3)
        assert {headers["x-fleetsight-delivery"] for headers, _ in receiver.got} == {"a1-5"}


async def test_each_attempt_is_signed_with_the_time_at_which_it_is_made() -> None:
    times = count(1_000)
    async with receiving(500, 500, 204) as (receiver, webhook), posting(lambda: next(times) + 0.9) as webhooks:
        webhooks.post("ops", webhook, alert())
        webhooks.post("ops", webhook, alert(id_="a2"))
        await until(lambda: len(receiver.got) == 4)
    stamps = [headers["x-fleetsight-timestamp"] for headers, _ in receiver.got]
    assert stamps == ["1000", "1001", "1002", "1003"]
    for headers, body in receiver.got:
        stamped = headers["x-fleetsight-timestamp"].encode() + b"." + body
        expected = hmac.new(SECRET.encode(), stamped, hashlib.sha256).hexdigest()
        assert headers["x-fleetsight-signature"] == f"sha256={expected}"


async def test_a_webhook_that_takes_nothing_is_a_problem_until_it_does_or_is_there_no_more() -> None:
    async with receiving(*[503] * TRIES, 200) as (_, webhook), posting() as webhooks:
        webhooks.post("ops", webhook, alert())
        await until(lambda: webhooks.problems({"ops": webhook}))
        assert webhooks.problems({"ops": webhook}) == ["webhook ops takes no alerts: status 503"]
        assert webhooks.problems({"other": webhook}) == []
        webhooks.post("ops", webhook, alert(id_="a2"))
        await until(lambda: not webhooks.problems({"ops": webhook}))
        assert webhooks.counts == {("ops", "delivered"): 2}


async def test_what_is_dropped_is_counted_and_said_once_until_all_is_delivered(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(backlog, "MAX_WAITING", 2)

    def said() -> int:
        told = [record.getMessage() for record in caplog.records]
        return sum(each.startswith("webhook ops: ") and "the oldest are dropped" in each for each in told)

    webhooks = Webhooks(first_wait_s=0.001)
    async with receiving(200) as (receiver, webhook):
        for number in range(5):
            webhooks.post("ops", webhook, alert(id_=f"a{number}"))
        assert (webhooks.counts, said()) == ({("ops", "dropped"): 3}, 1)
        running = asyncio.create_task(webhooks.run())
        await until(lambda: webhooks.counts["ops", Outcome.DELIVERED] == 2)
        for number in range(3):
            webhooks.post("ops", webhook, alert(id_=f"b{number}"))
        await until(lambda: webhooks.counts["ops", Outcome.DELIVERED] == 4)
        running.cancel()
        await asyncio.wait([running])
    assert (webhooks.counts["ops", Outcome.DROPPED], said(), len(receiver.got)) == (4, 2, 4)


@pytest.mark.parametrize(("status", "tries"), [(400, 1), (302, 1)])
async def test_what_is_not_taken_is_given_up_and_the_next_one_goes_on(status: int, tries: int) -> None:
    async with receiving(*[status] * tries, 200) as (receiver, webhook), posting() as webhooks:
        webhooks.post("ops", webhook, alert())
        webhooks.post("ops", webhook, alert(id_="next"))
        await until(lambda: len(receiver.got) == tries + 1)
        deliveries = [headers["x-fleetsight-delivery"] for headers, _ in receiver.got]
        assert deliveries == [*["a1-5"] * tries, "next-5"]


async def test_a_webhook_that_is_not_there_holds_up_no_other() -> None:
    nowhere = Webhook.model_validate({"url": "http://127.0.0.1:1/", "secret": SECRET})
    async with receiving(200) as (receiver, webhook), posting() as webhooks:
        webhooks.post("nowhere", nowhere, alert())
        webhooks.post("ops", webhook, alert())
        await until(lambda: len(receiver.got) == 1)


async def test_a_host_that_is_no_name_is_given_up_and_the_next_one_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    nowhere = Webhook.model_validate({"url": "http://\u2603.invalid/", "secret": SECRET})
    async with receiving(200) as (receiver, webhook), posting() as webhooks:
        webhooks.post("nowhere", nowhere, alert())
        await until(lambda: "webhook nowhere: alert a1 not taken" in caplog.text)
        webhooks.post("ops", webhook, alert())
        await until(lambda: len(receiver.got) == 1)


async def test_an_answer_without_an_end_holds_up_nothing() -> None:
    posts: list[str] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode()
        posts.append(next(line for line in head.split("\r\n") if line.lower().startswith("x-fleetsight-delivery")))
        writer.write(b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\n\r\n: and so on\n\n")
        await reader.read()  # to the end of the connection
        writer.close()

    async with await asyncio.start_server(serve, "127.0.0.1", 0) as server, posting() as webhooks:
        port = server.sockets[0].getsockname()[1]
        webhook = Webhook.model_validate({"url": f"http://127.0.0.1:{port}/", "secret": SECRET})
        for number in range(3):
            webhooks.post("ops", webhook, alert(id_=f"a{number}"))
        await until(lambda: len(posts) == 3)
        assert len(set(posts)) == 3


def test_the_signature_depends_on_the_secret_the_alert_and_the_time() -> None:
    names = [
        signed(said, secret, at_s).headers["X-Fleetsight-Signature"]
        for said, secret, at_s in (
            ([alert()], SECRET, 9),
            ([alert()], SECRET + "s", 9),
            ([alert(text="far")], SECRET, 9),
            ([alert()], SECRET, 10),
        )
    ]
    assert len(set(names)) == 4


def told(receiver: Receiver) -> list[list[tuple[str, str]]]:
    """Return the ids and states of the alerts in each post."""
    posts = [msgspec.json.decode(body) for _, body in receiver.got]
    return [[(each["id"], each["state"]) for each in post.get("alerts", [post])] for post in posts]


async def test_a_webhook_that_was_down_is_told_of_what_is_open_as_it_stands_when_it_is_back() -> None:
    async with receiving(*[503] * TRIES, 200) as (receiver, webhook), posting() as webhooks:
        some = [alert(id_=f"a{number}") for number in range(500)]
        for each in some:
            webhooks.post("ops", webhook, each)
        over = alert(id_="a7", state=AlertState.RESOLVED, changed_ns=9)
        webhooks.post("ops", webhook, over)
        await until(lambda: webhooks.counts["ops", Outcome.DELIVERED] == len(some))
    groups = told(receiver)[TRIES:]
    assert len(groups) == len(some) / GROUP, "grouped"
    assert sorted(each for group in groups for each in group) == sorted(
        [*((each.id, each.state) for each in some if each.id != "a7"), ("a7", "resolved")]
    )
    headers, body = receiver.got[-1]
    stamped = headers["x-fleetsight-timestamp"].encode() + b"." + body
    assert headers["x-fleetsight-signature"] == f"sha256={hmac.new(SECRET.encode(), stamped, 'sha256').hexdigest()}"


async def test_groups_come_at_a_bounded_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []
    sleep = asyncio.sleep

    async def noting(seconds: float) -> None:
        waits.append(seconds)
        await sleep(0)

    webhooks = Webhooks(first_wait_s=0.0, group_wait_s=7.0)
    async with receiving(200) as (receiver, webhook):
        webhooks.owe("ops", webhook, [alert(id_=f"a{number}") for number in range(3 * GROUP)])
        with monkeypatch.context() as patch:
            patch.setattr("services.monitor.alerting.webhooks.asyncio.sleep", noting)
            running = asyncio.create_task(webhooks.run())
            while len(receiver.got) < 3:
                await sleep(0.005)
            running.cancel()
            await asyncio.wait([running])
    assert waits.count(7.0) == 2


async def test_a_webhook_that_refuses_groups_is_told_of_each_alert_alone() -> None:
    async with receiving(*[503] * TRIES, 422, 200) as (receiver, webhook), posting() as webhooks:
        for number in range(3):
            webhooks.post("ops", webhook, alert(id_=f"a{number}"))
        await until(lambda: webhooks.counts["ops", Outcome.DELIVERED] == 3)
    assert [len(post) for post in told(receiver)] == [*[1] * TRIES, 3, 1, 1, 1]


async def test_what_a_webhook_did_not_take_is_known_and_goes_where_it_is_now() -> None:
    async with receiving(503) as (_, down), receiving(200) as (receiver, up), posting() as webhooks:
        webhooks.post("ops", down, alert())
        webhooks.post("gone", down, alert())
        assert [(name, each.id) for name, each in webhooks.owed()] == [("ops", "a1"), ("gone", "a1")]
        webhooks.keep({"ops": up})
        await until(lambda: len(receiver.got) == 1)
        await until(lambda: not list(webhooks.owed()))
        assert webhooks.problems({"ops": up, "gone": down}) == []
