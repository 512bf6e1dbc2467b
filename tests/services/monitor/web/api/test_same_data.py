"""What the WebSocket brings is what the API answers."""

import asyncio
import json
from typing import Any

import httpx
import websockets

from bus.fake import FakeNetwork
from services.monitor.web.api.live import TOPICS
from tests.services.monitor.web.api.seeing import fill
from tests.services.monitor.web.api.test_alerts import alert, raise_alert
from tests.services.monitor.web.serving import monitor_on, served

MOVING = {"age_s", "rate_hz"}
"""What differs from one moment to the next."""


def still(items: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return sorted(({name: item[name] for name in item if name not in MOVING} for item in items), key=json.dumps)


async def test_an_item_is_the_same_on_the_socket_and_in_the_answer() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        fill(monitor.fleet)
        raise_alert(monitor, alert())
        async with served(monitor) as at:
            token = {"Authorization": f"Bearer {at.token}"}
            async with httpx.AsyncClient(base_url=at.url, headers=token, timeout=20) as program:
                answered = {topic: (await program.get(f"/api/v1/{topic}")).json()["items"] for topic in TOPICS}
            where = f"ws{at.url.removeprefix('http')}/api/v1/live"
            async with websockets.connect(where, additional_headers=token) as socket, asyncio.timeout(20):
                brought = json.loads(await socket.recv())
    assert all(answered.values())
    assert set(brought) == {"now", *TOPICS}
    assert {topic: still(brought[topic]["changed"]) for topic in TOPICS} == {
        topic: still(items) for topic, items in answered.items()
    }
