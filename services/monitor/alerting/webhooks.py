"""Alerts posted to webhooks: signed, and tried again until they are taken or too old."""

import asyncio
import hashlib
import hmac
import logging
import random
import ssl
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import httpx
import msgspec

from schemas.alerts import Alert
from services.monitor.alerting.lanes import MAX_WAITING, Lanes
from services.monitor.rules.model import Webhook

log = logging.getLogger(__name__)

TRIES: Final = 6
FIRST_WAIT_S: Final = 1.0
TIMEOUT_S: Final = 5.0
TRY_LATER: Final = frozenset({408, 425, 429})


class Outcome(StrEnum):
    """What becomes of an alert for a webhook."""

    DELIVERED = "delivered"
    GIVEN_UP = "given_up"
    """It was not taken, however often it was tried."""
    DROPPED = "dropped"
    """Too many waited, it was the oldest."""


@dataclass(frozen=True, slots=True)
class Receiver:
    """A webhook by the name that the rule file gives it."""

    name: str
    webhook: Webhook


@dataclass(frozen=True, slots=True)
class Post:
    """What is posted. Its signature is HMAC-SHA256, in hexadecimal, of the timestamp, a full stop and the body."""

    body: bytes
    headers: Mapping[str, str]


def signed(alert: Alert, secret: str, at_s: float) -> Post:
    """Return an alert as it is posted at a time, epoch; it has the same delivery id however often it is tried."""
    body = msgspec.json.encode(alert)
    timestamp = str(int(at_s))
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
    """Posts to any number of webhooks, to each in order. now_s: the time, epoch.

    counts: by name and outcome.
    """

    def __init__(self, first_wait_s: float = FIRST_WAIT_S, now_s: Callable[[], float] = time.time) -> None:
        self.counts: Counter[tuple[str, Outcome]] = Counter()
        self._first_wait_s = first_wait_s
        self._now_s = now_s
        self._failing: dict[Receiver, str] = {}
        self._client: httpx.AsyncClient | None = None
        self._begun = asyncio.Event()
        self._lanes = Lanes(self._deliver, self._gave_up)

    def post(self, name: str, webhook: Webhook, alert: Alert) -> None:
        """Have an alert posted."""
        self._lanes.put(Receiver(name, webhook), alert)
        self._begun.set()

    def problems(self, webhooks: Mapping[str, Webhook]) -> list[str]:
        """Say which of these webhooks did not take what was posted last, and why."""
        failing = sorted((each.name, reason) for each, reason in self._failing.items() if _is_in(each, webhooks))
        return [f"webhook {name} takes no alerts: {reason}" for name, reason in failing]

    async def run(self) -> None:
        """Post what there is to post, for ever."""
        await self._begun.wait()
        trusted = await asyncio.to_thread(ssl.create_default_context)  # reads hundreds of certificates
        async with httpx.AsyncClient(timeout=TIMEOUT_S, trust_env=False, verify=trusted) as self._client:
            await self._lanes.run()

    async def _deliver(self, receiver: Receiver, alert: Alert) -> None:
        assert self._client is not None, "messages are delivered while it runs"  # noqa: S101 - for the type
        webhook = receiver.webhook
        for number in range(TRIES):
            post = signed(alert, webhook.secret, self._now_s())
            reason, again = await _try(self._client, str(webhook.url), post)
            if not reason:
                self._failing.pop(receiver, None)
                self.counts[receiver.name, Outcome.DELIVERED] += 1
                return
            self._failing[receiver] = reason
            log.warning("webhook %s: alert %s not taken: %s", receiver.name, alert.id, reason)
            if not again:
                break
            if number + 1 < TRIES:
                await asyncio.sleep(self._first_wait_s * 2**number * random.uniform(0.75, 1.25))  # noqa: S311 - jitter
        self.counts[receiver.name, Outcome.GIVEN_UP] += 1

    def _gave_up(self, receiver: Receiver, first: bool) -> None:  # noqa: FBT001 - the lanes'
        self.counts[receiver.name, Outcome.DROPPED] += 1
        if first:
            log.warning("webhook %s: %d alerts wait, the oldest are dropped", receiver.name, MAX_WAITING)


def _is_in(receiver: Receiver, webhooks: Mapping[str, Webhook]) -> bool:
    return webhooks.get(receiver.name) == receiver.webhook


async def _try(client: httpx.AsyncClient, url: str, post: Post) -> tuple[str, bool]:
    """Post once; return why it was not taken, empty if it was, and whether it makes sense to try again."""
    try:
        # the answer's body is left alone: it may have no end
        async with client.stream("POST", url, content=post.body, headers=dict(post.headers)) as response:
            pass
    except httpx.HTTPError as error:
        return str(error) or type(error).__name__, True
    except (httpx.InvalidURL, UnicodeError) as error:  # a host that httpx takes for no name, as rule files need not
        return str(error), False
    if response.is_success:
        return "", False
    return f"status {response.status_code}", response.is_server_error or response.status_code in TRY_LATER
