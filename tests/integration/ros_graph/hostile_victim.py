"""A node that others attack: it publishes /out, a megabyte thirty times a second, and says what it hears on /in.

Arguments: the master's URI, seconds for handshakes, and the largest message that /in takes.
"""

import asyncio
import sys
from contextlib import suppress

from gateway.ros1.messages import deserialise, new_message, serialise
from gateway.ros1.node import Node
from gateway.ros1.tcpros.subscriber import Message

STRING = "std_msgs/String"
PAYLOAD = serialise(STRING, new_message(STRING, data="x" * (1 << 20)))


def say(text: str) -> None:
    """Tell the test."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def heard(message: Message) -> None:
    """Say who was heard."""
    say(f"heard {message.callerid} {len(deserialise(STRING, message.data).data)}")


async def main() -> None:
    """Serve until killed."""
    uri, timeout, max_message_bytes = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
    async with (
        Node("/victim", master_uri=uri, timeout=timeout, poll_interval=0.2) as node,
        node.advertise("/out", STRING) as publication,
        node.subscribe("/in", STRING, heard, max_message_bytes=max_message_bytes),
    ):
        say("victim up")
        while not node.shutdown_requested.is_set():
            publication.publish(PAYLOAD)
            await asyncio.sleep(1 / 30)


with suppress(KeyboardInterrupt):
    asyncio.run(main())
