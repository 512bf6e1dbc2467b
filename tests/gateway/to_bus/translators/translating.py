"""One message through a stream, as the gateway sends it through."""

from typing import TypeVar

from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.stream import StreamForward
from gateway.to_bus.translators import kind_of
from schemas import codec, keys
from schemas.codec import Message as OurMessage

M = TypeVar("M", bound=OurMessage)


def forward(name: str) -> StreamForward:
    """Return a stream of robot r1."""
    key = keys.sensor_key("r1", name)
    return StreamForward(key, "/topic", kind_of(key), "boot")


def translated(schema: type[M], name: str, message: Message, *, repaired: bool = False) -> M:
    """Return what the message becomes on the named stream, and check whether it is counted as repaired."""
    stream = forward(name)
    made = stream.take(message, 99)
    assert made is not None
    status = stream.status(wanted=True, publishers=1, replaced=0, broken_links={})
    assert (status.forwarded, status.repaired) == (1, int(repaired))
    return codec.decode(schema, codec.encode(made), stream.kind.encoding)


def dropped(name: str, message: Message) -> dict[str, int]:
    """Return the drops that the message is counted under."""
    stream = forward(name)
    assert stream.take(message, 99) is None
    return stream.status(wanted=True, publishers=1, replaced=0, broken_links={}).dropped
