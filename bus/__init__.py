"""The bus between the processes of a fleet; the only package that imports zenoh.

Publishers know whether they are wanted, subscriptions are bounded, presence is seen, requests are answered or end in an
error in time. Payloads are bytes, or pieces of them; the bus does not interpret them.
"""

from bus.api import (
    DEFAULT_ENCODING,
    LATEST,
    MAX_PAYLOAD_BYTES,
    MAX_REQUEST_BYTES,
    MAX_TIMEOUT_S,
    QUEUE,
    SMALL_BYTES,
    SMALL_WAITING,
    Bus,
    Handler,
    Latest,
    Presence,
    Publisher,
    PublisherCounts,
    QoS,
    Queue,
    Reply,
    Request,
    Sample,
    Subscription,
    SubscriptionCounts,
    Watch,
)
from bus.delivery.split_payload import Payload, Pieces
from bus.errors import BusClosedError, BusError, NotServedError, RefusedError, RequestError, RequestTimeoutError
from bus.settings import BusSettings
from bus.zenoh_bus import open_bus

__all__ = [
    "DEFAULT_ENCODING",
    "LATEST",
    "MAX_PAYLOAD_BYTES",
    "MAX_REQUEST_BYTES",
    "MAX_TIMEOUT_S",
    "QUEUE",
    "SMALL_BYTES",
    "SMALL_WAITING",
    "Bus",
    "BusClosedError",
    "BusError",
    "BusSettings",
    "Handler",
    "Latest",
    "NotServedError",
    "Payload",
    "Pieces",
    "Presence",
    "Publisher",
    "PublisherCounts",
    "QoS",
    "Queue",
    "RefusedError",
    "Reply",
    "Request",
    "RequestError",
    "RequestTimeoutError",
    "Sample",
    "Subscription",
    "SubscriptionCounts",
    "Watch",
    "open_bus",
]
