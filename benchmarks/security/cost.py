"""What access rules cost: the time that a router takes for a message, and for a robot that joins, with and without."""

import threading
import time
from pathlib import Path
from statistics import median
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from schemas import keys
from tests.services.access.links import FLEET, make_pki, member, router, until_matching

MESSAGES: Final = 20_000
ROUNDS: Final = 5
ROBOTS: Final = 1_000
JOINS: Final = 15
KEY: Final = "fleet/r1/front/classes"
PAYLOAD: Final = b"x" * 300
TIMEOUT_S: Final = 60.0


def cost_of_rules(folder: Path) -> dict[str, Any]:
    """Return the cost of a message and of a robot that joins, on TLS links with access rules and without."""
    make_pki(folder)
    return _of_messages(folder) | _of_joining(folder)


def _of_messages(folder: Path) -> dict[str, Any]:
    """Return the medians of ROUNDS turns each, one after the other, as other things run on the machine, too."""
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


def _of_joining(folder: Path) -> dict[str, Any]:
    """Return how long it takes until a robot that opens a session is seen, where the rules name ROBOTS robots."""
    fleet = FLEET.replace("[r1..r3]", f"[r1..r{ROBOTS}]")
    took: dict[bool, list[float]] = {True: [], False: []}
    with (
        router(folder, fleet=fleet) as (ruled, there),
        router(folder, rules=False) as (bare, elsewhere),
    ):
        for _ in range(JOINS):
            took[True].append(_joining_ms(folder, ruled, there))
            took[False].append(_joining_ms(folder, bare, elsewhere))
    return {
        "rules_for_robots": ROBOTS,
        "joining_ms_with_rules": round(median(took[True]), 1),
        "joining_ms_without": round(median(took[False]), 1),
    }


def _joining_ms(folder: Path, watcher: zenoh.Session, endpoint: str) -> float:
    seen = threading.Event()

    def take(_: zenoh.Sample) -> None:
        seen.set()

    watching = watcher.liveliness().declare_subscriber(keys.robot_alive("r1"), Callback(take, indirect=False))
    try:
        began_s = time.perf_counter()
        with member(folder, "r1", endpoint) as session, session.liveliness().declare_token(keys.robot_alive("r1")):
            if not seen.wait(TIMEOUT_S):
                raise TimeoutError("a robot that joined was not seen")
            return (time.perf_counter() - began_s) * 1e3
    finally:
        watching.undeclare()


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
        if not done.wait(TIMEOUT_S):
            raise TimeoutError(f"{left[0]} of {MESSAGES} messages did not arrive")
        return (time.perf_counter() - began_s) / MESSAGES * 1e6
    finally:
        publisher.undeclare()
        subscriber.undeclare()
