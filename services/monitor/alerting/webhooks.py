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


class _Answer(StrEnum):
    """The outcome of one post."""

    TAKEN = "taken"
    REFUSED = "refused"
    """It would be again."""
    FAILED = "failed"
    """The webhook had an error, or did not answer: it is down, or it is this post that it cannot deal with."""
    LATER = "later"
    """It was not there, or has too much to do."""


class Outcome(StrEnum):
    """The outcome of an alert for a webhook."""

    DELIVERED = "delivered"
    GIVEN_UP = "given_up"
    """It was refused, or always failed, and would again."""
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

    reason: why it did not take what was posted last. probes: it failed at a group, and is given one alert alone next.
    alone: how many are posted one by one, since it takes no groups, before a group is tried again. drops: too much
    waited.
    """

    name: str
    webhook: Webhook
    backlog: Backlog = field(default_factory=Backlog)
    reason: str = ""
    probes: bool = False
    alone: int = 0
    is_busy: bool = False
    drops: bool = False


class Webhooks:
    """Posts alerts to any number of webhooks, in order for each. now_s: returns the epoch time.

    A webhook that accepts nothing after all tries is down. Changes wait meanwhile, of each alert as it
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

    def changes(self) -> int:
        """Return how often what waits has changed."""
        return sum(lane.backlog.changes for lane in self._lanes.values())

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
        lane.alone = 0
        self._news.set()

    async def _post_first(self, lane: _Lane) -> None:
        """Post what waits longest; have the webhook be down if it is never taken."""
        alert = lane.backlog.first(1)[0]
        for number in range(TRIES):
            if await self._post(lane, [alert]) in (_Answer.TAKEN, _Answer.REFUSED):
                return
            if number + 1 < TRIES:
                await asyncio.sleep(self._first_wait_s * 2**number * _jitter())
            if alert not in lane.backlog:
                return
        lane.backlog.fold()
        log.warning("webhook %s is down: it gets the alerts that changed once it is back", lane.name)
        await asyncio.sleep(self._down_wait_s * _jitter())

    async def _post_group(self, lane: _Lane) -> None:
        """Post some of what waits for a webhook that is, or was, down."""
        group = lane.backlog.first(1 if lane.alone or lane.probes else GROUP)
        answer = await self._post(lane, group)
        soon = self._after_group(lane, answer) if len(group) > 1 else self._after_single(lane, group[0], answer)
        if lane.backlog or not soon:
            await asyncio.sleep(self._group_wait_s if soon else self._down_wait_s * _jitter())

    def _after_group(self, lane: _Lane, answer: _Answer) -> bool:
        """Choose what is posted next; return whether that is so soon.

        A webhook that knows single alerts only refuses groups, or has an error of them: one alone tells.
        """
        lane.alone = GROUP if answer is _Answer.REFUSED else 0
        lane.probes = answer is _Answer.FAILED
        return answer is not _Answer.LATER

    def _after_single(self, lane: _Lane, alert: Alert, answer: _Answer) -> bool:
        """As `_after_group`. An alert that always fails, while others are taken, is given up after some tries."""
        probed, lane.probes = lane.probes, False
        if answer is _Answer.TAKEN:
            lane.alone = GROUP if probed else max(0, lane.alone - 1)
        if answer is not _Answer.FAILED:
            return answer is not _Answer.LATER
        failures = lane.backlog.put_off(alert)
        if failures >= TRIES:
            lane.backlog.done([alert])
            self.counts[lane.name, Outcome.GIVEN_UP] += 1
        return failures > 1

    async def _post(self, lane: _Lane, alerts: Sequence[Alert]) -> _Answer:
        """Post alerts once; those that were taken, or that alone are refused, wait no more."""
        assert self._client is not None, "messages are delivered while it runs"  # noqa: S101 - for the type
        webhook = lane.webhook
        post = signed(alerts, webhook.secret, self._now_s())
        answer, reason = await _try(self._client, str(webhook.url), post)
        if not lane.backlog:  # the webhook is gone
            return _Answer.TAKEN
        lane.reason = reason
        if reason:
            log.warning("webhook %s: alert %s not taken: %s", lane.name, alerts[0].id, reason)
        if answer is _Answer.TAKEN or (answer is _Answer.REFUSED and len(alerts) == 1):
            lane.backlog.done(alerts)
            outcome = Outcome.DELIVERED if answer is _Answer.TAKEN else Outcome.GIVEN_UP
            self.counts[lane.name, outcome] += len(alerts)
        return answer


def _jitter() -> float:
    return random.uniform(0.75, 1.25)  # noqa: S311 - waits, no secrets


async def _try(client: httpx.AsyncClient, url: str, post: Post) -> tuple[_Answer, str]:
    """Post once; return the outcome, and why it was refused, empty if accepted."""
    try:
        # the answer's body is left alone: it may have no end
        async with client.stream("POST", url, content=post.body, headers=dict(post.headers)) as response:
            pass
    except httpx.HTTPError as error:
        is_there = not isinstance(error, httpx.ConnectError | httpx.ConnectTimeout)
        return _Answer.FAILED if is_there else _Answer.LATER, str(error) or type(error).__name__
    except (httpx.InvalidURL, UnicodeError) as error:  # a host that httpx takes for no name, as rule files need not
        return _Answer.REFUSED, str(error)
    if response.is_success:
        return _Answer.TAKEN, ""
    reason = f"status {response.status_code}"
    if response.is_server_error:
        return _Answer.FAILED, reason
    return _Answer.LATER if response.status_code in TRY_LATER else _Answer.REFUSED, reason
