"""What access rules cost a message: the time that a router takes for it, with rules and without."""

import threading
import time
from pathlib import Path
from statistics import median
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from tests.services.access.links import make_pki, member, router, until_matching

MESSAGES: Final = 20_000
ROUNDS: Final = 5
KEY: Final = "fleet/r1/front/classes"
PAYLOAD: Final = b"x" * 300
PATIENCE_S: Final = 60.0


def cost_of_rules(folder: Path) -> dict[str, Any]:
    """Return the microseconds of a message on a TLS link with access rules and without, and their difference.

    The medians of ROUNDS turns each, one after the other, as other things run on the machine, too.
    """
    make_pki(folder)
    took: dict[bool, list[float]] = {True: [], False: []}
    with (
        router(folder) as (ruled, there),
        router(folder, rules=False) as (bare, elsewhere),
        member(folder, "gpu1", there) as one,
        member(folder, "gpu1", elsewhere) as other,
    ):
        for _ in range(ROUNDS):
            took[True].append(_us_per_message(one, ruled))
            took[False].append(_us_per_message(other, bare))
    with_rules, without = median(took[True]), median(took[False])
    return {
        "us_per_message_with_rules": round(with_rules, 2),
        "us_per_message_without": round(without, 2),
        "acl_us_per_message": round(with_rules - without, 2),
    }


def _us_per_message(sender: zenoh.Session, receiver: zenoh.Session) -> float:
    """Send messages; return how long each took, all received."""
    left, done = [MESSAGES], threading.Event()

    def take(_: zenoh.Sample) -> None:
        left[0] -= 1
        if not left[0]:
            done.set()

    subscriber = receiver.declare_subscriber(KEY, Callback(take, indirect=False))
    publisher = sender.declare_publisher(KEY, congestion_control=zenoh.CongestionControl.BLOCK)
    try:
        until_matching(publisher, expected=True)
        began_s = time.perf_counter()
        for _ in range(MESSAGES):
            publisher.put(PAYLOAD)
        if not done.wait(PATIENCE_S):
            raise TimeoutError(f"{left[0]} of {MESSAGES} messages did not arrive")
        return (time.perf_counter() - began_s) / MESSAGES * 1e6
    finally:
        publisher.undeclare()
        subscriber.undeclare()
