"""Posts alerts to webhooks: signed, and retried until they are accepted."""

import asyncio
import hashlib
import hmac
import logging
import random
import ssl
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

import httpx
import msgspec

from schemas.alerts import Alert
from services.monitor.alerting.backlog import Backlog
from services.monitor.rules.model import Webhook

log = logging.getLogger(__name__)

TRIES: Final = 6
FIRST_WAIT_S: Final = 1.0
TIMEOUT_S: Final = 5.0
DOWN_WAIT_S: Final = 30.0
"""How often a webhook that is down is tried."""

GROUP: Final = 50
"""Alerts in one post to a webhook that is back."""

GROUP_WAIT_S: Final = 1.0
"""How long the next of these posts waits."""

TRY_LATER: Final = frozenset({408, 425, 429})


class Outcome(StrEnum):
    """The outcome of an alert for a webhook."""

    DELIVERED = "delivered"
    GIVEN_UP = "given_up"
    """It was refused, and would be again."""
    DROPPED = "dropped"
    """Too many waited."""


@dataclass(frozen=True, slots=True)
class Post:
    """A request to post. Its signature is HMAC-SHA256, in hexadecimal, of the timestamp, a full stop and the body."""

    body: bytes
    headers: Mapping[str, str]


def signed(alerts: Sequence[Alert], secret: str, at_s: float) -> Post:
    """Return the signed post of an alert, or of a group of alerts, at an epoch time.

    The delivery id is the same however often that is tried.
    """
    body = msgspec.json.encode(alerts[0] if len(alerts) == 1 else {"alerts": alerts})
    timestamp = str(int(at_s))
    signature = hmac.new(secret.encode(), timestamp.encode() + b"." + body, hashlib.sha256).hexdigest()
    single = f"{alerts[0].id}-{alerts[0].changed_ns}"
    return Post(
        body,
        {
            "Content-Type": "application/json",
            "X-Fleetsight-Delivery": single if len(alerts) == 1 else hashlib.sha256(body).hexdigest()[:32],
            "X-Fleetsight-Timestamp": timestamp,
            "X-Fleetsight-Signature": f"sha256={signature}",
        },
    )


@dataclass(slots=True, eq=False)
class _Lane:
    """A webhook under its name in the rule file, and its backlog.

    reason: why it did not take what was posted last. is_single: it refused a group. drops: too much waited.
    """

    name: str
    webhook: Webhook
    backlog: Backlog = field(default_factory=Backlog)
    reason: str = ""
    is_single: bool = False
    is_busy: bool = False
    drops: bool = False


class Webhooks:
    """Posts alerts to any number of webhooks, in order for each. now_s: returns the epoch time.

    A webhook that takes nothing, however often it is tried, is down. What changes meanwhile waits, of each alert as it
    stands, and is posted in groups once it is back. counts: alerts by webhook and outcome.
    """

    def __init__(
        self,
        first_wait_s: float = FIRST_WAIT_S,
        now_s: Callable[[], float] = time.time,
        *,
        down_wait_s: float = DOWN_WAIT_S,
        group_wait_s: float = GROUP_WAIT_S,
    ) -> None:
        self.counts: Counter[tuple[str, Outcome]] = Counter()
        self._first_wait_s = first_wait_s
        self._down_wait_s = down_wait_s
        self._group_wait_s = group_wait_s
        self._now_s = now_s
        self._lanes: dict[str, _Lane] = {}
        self._client: httpx.AsyncClient | None = None
        self._news = asyncio.Event()

    def post(self, name: str, webhook: Webhook, alert: Alert) -> None:
        """Queue an alert for a webhook."""
        lane = self._lanes.setdefault(name, _Lane(name, webhook))
        lane.webhook = webhook
        dropped = lane.backlog.put(alert)
        if dropped and not lane.drops:
            log.warning("webhook %s: %d alerts wait, the oldest are dropped", name, len(lane.backlog))
        lane.drops = lane.drops or dropped > 0
        if dropped:
            self.counts[name, Outcome.DROPPED] += dropped
        self._news.set()

    def owe(self, name: str, webhook: Webhook, alerts: Iterable[Alert]) -> None:
        """Queue alerts, to be posted in groups, that were not accepted before a restart."""
        self._lanes.setdefault(name, _Lane(name, webhook)).backlog.fold()
        for alert in alerts:
            self.post(name, webhook, alert)

    def owed(self) -> Iterator[tuple[str, Alert]]:
        """Yield the waiting alerts by webhook, each in its current state."""
        for name, lane in self._lanes.items():
            yield from ((name, alert) for alert in lane.backlog.newest())

    def keep(self, webhooks: Mapping[str, Webhook]) -> None:
        """Continue with these webhooks only; waiting alerts follow a changed address or secret."""
        for name, lane in list(self._lanes.items()):
            if name in webhooks:
                lane.webhook = webhooks[name]
            else:
                lane.backlog.clear()
                lane.reason = ""

    def clear(self) -> None:
        """Drop the waiting alerts: another monitor posts them."""
        self.keep({})

    def problems(self, webhooks: Mapping[str, Webhook]) -> list[str]:
        """Return a line for each of these webhooks that did not accept its last post, with the reason."""
        failing = [lane for _, lane in sorted(self._lanes.items()) if lane.reason and lane.name in webhooks]
        return [f"webhook {lane.name} takes no alerts: {lane.reason}" for lane in failing]

    async def run(self) -> None:
        """Post queued alerts until cancelled."""
        await self._news.wait()
        trusted = await asyncio.to_thread(ssl.create_default_context)  # reads hundreds of certificates
        async with (
            httpx.AsyncClient(timeout=TIMEOUT_S, trust_env=False, verify=trusted) as self._client,
            asyncio.TaskGroup() as group,
        ):
            while True:
                await self._news.wait()
                self._news.clear()
                for lane in [lane for lane in self._lanes.values() if lane.backlog and not lane.is_busy]:
                    lane.is_busy = True
                    group.create_task(self._empty(lane))

    async def _empty(self, lane: _Lane) -> None:
        while lane.backlog:
            await (self._post_group(lane) if lane.backlog.is_folded else self._post_first(lane))
        lane.is_busy = lane.drops = False
        self._news.set()

    async def _post_first(self, lane: _Lane) -> None:
        """Post what waits longest; have the webhook be down if it is never taken."""
        alert = lane.backlog.first(1)[0]
        for number in range(TRIES):
            if await self._is_done(lane, [alert]):
                return
            if number + 1 < TRIES:
                await asyncio.sleep(self._first_wait_s * 2**number * _jitter())
        lane.backlog.fold()
        log.warning("webhook %s is down: it is told what is open once it is back", lane.name)
        await asyncio.sleep(self._down_wait_s * _jitter())

    async def _post_group(self, lane: _Lane) -> None:
        """Post some of what waits for a webhook that is, or was, down."""
        group = lane.backlog.first(1 if lane.is_single else GROUP)
        done = await self._is_done(lane, group)
        if lane.backlog or not done:
            await asyncio.sleep(self._group_wait_s if done else self._down_wait_s * _jitter())

    async def _is_done(self, lane: _Lane, alerts: Sequence[Alert]) -> bool:
        """Post alerts once; return whether they were taken, or never will be."""
        assert self._client is not None, "messages are delivered while it runs"  # noqa: S101 - for the type
        webhook = lane.webhook
        post = signed(alerts, webhook.secret, self._now_s())
        reason, again = await _try(self._client, str(webhook.url), post)
        if not lane.backlog:  # the webhook is gone
            return True
        lane.reason = reason
        if reason:
            log.warning("webhook %s: alert %s not taken: %s", lane.name, alerts[0].id, reason)
        if reason and again:
            return False
        if reason and len(alerts) > 1:  # it may know single alerts only
            lane.is_single = True
            return True
        lane.backlog.done(alerts)
        self.counts[lane.name, Outcome.GIVEN_UP if reason else Outcome.DELIVERED] += len(alerts)
        return True


def _jitter() -> float:
    return random.uniform(0.75, 1.25)  # noqa: S311 - waits, no secrets


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
