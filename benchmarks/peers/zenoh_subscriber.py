"""Takes every payload of a key whole. Arguments: Zenoh config, key.

Says how many distinct frames came, and of those since it was last asked (the newest 1,000) when they were made, their
age in nanoseconds on arrival, and their age since the gateway had them, where their header tells.
"""

import struct
import sys
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Final

import zenoh
from zenoh.handlers import Callback

from benchmarks.peers.answering import answer
from benchmarks.peers.frames import sent_ns

_RECEIVED: Final = b"\xabreceived_ns\xcf"
"""What stands in a MessagePack map before a time that a gateway received a frame at."""


@dataclass(slots=True)
class Account:
    """What came."""

    frames: int = 0
    newest: int = 0
    arrivals: deque[tuple[int, int, bytes | bytearray]] = field(default_factory=lambda: deque(maxlen=1000))

    def take(self, payload: bytes | bytearray) -> None:
        """Count a frame."""
        sent = sent_ns(payload)
        self.frames += sent != self.newest
        self.newest = sent
        self.arrivals.append((sent, time.time_ns(), payload[:1024]))

    def told(self) -> dict[str, object]:
        """Return it, and forget the arrivals."""
        arrivals = [self.arrivals.popleft() for _ in range(len(self.arrivals))]
        return {
            "frames": self.frames,
            "sent_ns": [sent for sent, _, _ in arrivals],
            "age_ns": [now - sent for sent, now, _ in arrivals],
            "age_in_gateway_ns": [now - received_ns(head) for _, now, head in arrivals if _RECEIVED in head],
        }


def received_ns(head: bytes | bytearray) -> int:
    """Return when the gateway had the frame."""
    (received,) = struct.unpack_from(">Q", head, head.index(_RECEIVED) + len(_RECEIVED))
    return int(received)


if __name__ == "__main__":
    account = Account()

    def on_sample(sample: zenoh.Sample) -> None:
        """Copy the payload out of Zenoh."""
        account.take(sample.payload.to_bytes())

    with zenoh.open(zenoh.Config.from_json5(sys.argv[1])) as session:
        session.declare_subscriber(sys.argv[2], Callback(on_sample, indirect=False))
        answer(account.told)
