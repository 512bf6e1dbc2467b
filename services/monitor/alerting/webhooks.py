"""Alerts posted to webhooks: signed, and tried again until they are taken or too old."""

import asyncio
import hashlib
import hmac
import logging
import random
import ssl
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import httpx
import msgspec

from schemas.alerts import Alert
from services.monitor.rules.model import Webhook

log = logging.getLogger(__name__)

MAX_WAITING: Final = 1_000
"""How many alerts wait for one webhook; the oldest are given up for newer ones."""

TRIES: Final = 6
FIRST_WAIT_S: Final = 1.0
TIMEOUT_S: Final = 5.0
TRY_LATER: Final = frozenset({408, 425, 429})


@dataclass(frozen=True, slots=True)
class Post:
    """What is posted. Its signature is HMAC-SHA256, in hexadecimal, of the timestamp, a full stop and the body."""

    body: bytes
    headers: Mapping[str, str]


def signed(alert: Alert, secret: str) -> Post:
    """Return an alert as it is posted; the same one has the same delivery id however often it is tried."""
    body = msgspec.json.encode(alert)
    timestamp = str(alert.changed_ns // 1_000_000_000)
    signature = hmac.new(secret.encode(), timestamp.encode() + b"." + body, hashlib.sha256).hexdigest()
    return Post(
        body,
        {
            "Content-Type": "application/json",
            "X-Fleetsight-Delivery": f"{alert.id}-{alert.changed_ns}",
            "X-Fleetsight-Timestamp": timestamp,
            "X-Fleetsight-Signature": f"sha256={signature}",
        },
    )


class Webhooks:
    """Posts to any number of webhooks, to each in order. given_up: alerts that none of the tries delivered."""

    def __init__(self, first_wait_s: float = FIRST_WAIT_S) -> None:
        self.given_up = 0
        self._first_wait_s = first_wait_s
        self._waiting: dict[Webhook, deque[Alert]] = {}
        self._news = asyncio.Event()

    def post(self, webhook: Webhook, alert: Alert) -> None:
        """Have an alert posted."""
        waiting = self._waiting.setdefault(webhook, deque())
        if len(waiting) >= MAX_WAITING:
            waiting.popleft()
            self.given_up += 1
        waiting.append(alert)
        self._news.set()

    async def run(self) -> None:
        """Post what there is to post, for ever."""
        busy: dict[Webhook, asyncio.Task[None]] = {}
        await self._news.wait()
        trusted = await asyncio.to_thread(ssl.create_default_context)  # reads hundreds of certificates
        async with (
            httpx.AsyncClient(timeout=TIMEOUT_S, trust_env=False, verify=trusted) as client,
            asyncio.TaskGroup() as group,
        ):
            while True:
                await self._news.wait()
                self._news.clear()
                for webhook, waiting in list(self._waiting.items()):
                    if waiting and (webhook not in busy or busy[webhook].done()):
                        busy[webhook] = group.create_task(self._empty(client, webhook, waiting))
                    elif not waiting:
                        busy.pop(webhook, None)
                        del self._waiting[webhook]

    async def _empty(self, client: httpx.AsyncClient, webhook: Webhook, waiting: deque[Alert]) -> None:
        try:
            while waiting:
                await self._deliver(client, webhook, waiting.popleft())
        finally:
            self._news.set()

    async def _deliver(self, client: httpx.AsyncClient, webhook: Webhook, alert: Alert) -> None:
        post = signed(alert, webhook.secret)
        for number in range(TRIES):
            reason, again = await _try(client, str(webhook.url), post)
            if not reason:
                return
            log.warning("webhook %s: alert %s not taken: %s", webhook.url.host, alert.id, reason)
            if not again:
                break
            if number + 1 < TRIES:
                await asyncio.sleep(self._first_wait_s * 2**number * random.uniform(0.75, 1.25))  # noqa: S311 - jitter
        self.given_up += 1


async def _try(client: httpx.AsyncClient, url: str, post: Post) -> tuple[str, bool]:
    """Post once; return why it was not taken, empty if it was, and whether it makes sense to try again."""
    try:
        response = await client.post(url, content=post.body, headers=dict(post.headers))
    except httpx.HTTPError as error:
        return str(error) or type(error).__name__, True
    if response.is_success:
        return "", False
    return f"status {response.status_code}", response.is_server_error or response.status_code in TRY_LATER
