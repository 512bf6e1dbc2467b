"""Alerts posted to webhooks: signed, and tried again until they are taken or too old."""

import asyncio
import hashlib
import hmac
import logging
import random
import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import httpx
import msgspec

from schemas.alerts import Alert
from services.monitor.alerting.lanes import Lanes
from services.monitor.rules.model import Webhook

log = logging.getLogger(__name__)

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
    """Posts to any number of webhooks, to each in order."""

    def __init__(self, first_wait_s: float = FIRST_WAIT_S) -> None:
        self._first_wait_s = first_wait_s
        self._client: httpx.AsyncClient | None = None
        self._begun = asyncio.Event()
        self._lanes = Lanes(self._deliver)

    def post(self, webhook: Webhook, alert: Alert) -> None:
        """Have an alert posted."""
        self._lanes.put(webhook, alert)
        self._begun.set()

    async def run(self) -> None:
        """Post what there is to post, for ever."""
        await self._begun.wait()
        trusted = await asyncio.to_thread(ssl.create_default_context)  # reads hundreds of certificates
        async with httpx.AsyncClient(timeout=TIMEOUT_S, trust_env=False, verify=trusted) as self._client:
            await self._lanes.run()

    async def _deliver(self, webhook: Webhook, alert: Alert) -> None:
        assert self._client is not None, "messages are delivered while it runs"  # noqa: S101 - for the type
        post = signed(alert, webhook.secret)
        for number in range(TRIES):
            reason, again = await _try(self._client, str(webhook.url), post)
            if not reason:
                return
            log.warning("webhook %s: alert %s not taken: %s", webhook.url.host, alert.id, reason)
            if not again:
                return
            if number + 1 < TRIES:
                await asyncio.sleep(self._first_wait_s * 2**number * random.uniform(0.75, 1.25))  # noqa: S311 - jitter


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
