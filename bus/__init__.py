"""The bus between the processes of a fleet; the only package that imports zenoh.

Publishers know whether they are wanted, subscriptions are bounded, presence is seen. Payloads are bytes; what they mean
is for others to say.
"""

from bus.api import (
    DEFAULT_ENCODING,
    LATEST,
    QUEUE,
    Bus,
    Latest,
    Presence,
    Publisher,
    PublisherCounts,
    QoS,
    Queue,
    Sample,
    Subscription,
    SubscriptionCounts,
    Watch,
)
from bus.errors import BusClosedError, BusError
from bus.settings import BusSettings
from bus.zenoh_bus import open_bus

__all__ = [
    "DEFAULT_ENCODING",
    "LATEST",
    "QUEUE",
    "Bus",
    "BusClosedError",
    "BusError",
    "BusSettings",
    "Latest",
    "Presence",
    "Publisher",
    "PublisherCounts",
    "QoS",
    "Queue",
    "Sample",
    "Subscription",
    "SubscriptionCounts",
    "Watch",
    "open_bus",
]
