"""The session of a client to which others connect: it is open, and serves them, while its router is not there.

Zenoh (1.10) opens a client only once a router answers, but then tries for ever to replace a link that is lost. So the
session's first router is an empty one in the same process, which ends at once.
"""

import json
import logging
import os
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from random import uniform
from tempfile import TemporaryDirectory
from typing import Any, Final

import zenoh

from bus.delivery.writing import MessageWriter
from bus.session.declaration import Declaration, close_session
from bus.session.links import fits
from bus.session.probe import subscribe_briefly, why_not_taken
from bus.settings import BusSettings

MEMORY: Final = "/dev/shm"  # noqa: S108 - the folder in it has a random name and is its user's alone
"""A folder that can be written to also where the root file system cannot."""


def open_listening_client(config: Callable[[str], Mapping[str, Any]]) -> zenoh.Session:
    """Open a session and leave it to find its router.

    config: given the endpoint to connect to first, returns Zenoh's configuration.

    Raises:
        zenoh.ZError: an endpoint to listen on is taken or refused.
        OSError: no folder can be written to.
    """
    with _empty_router() as endpoint:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(config(endpoint))))


@contextmanager
def _empty_router() -> Iterator[str]:
    """Run a router at a Unix socket that nobody else can reach; yield its endpoint."""
    folder = MEMORY if os.access(MEMORY, os.W_OK) else None
    with TemporaryDirectory(prefix="fleetsight-", dir=folder, ignore_cleanup_errors=True) as own:
        endpoint = f"unixsock-stream/{own}/router"
        config = {
            "mode": "router",
            "listen": {"endpoints": [endpoint]},
            "scouting": {"delay": 0, "multicast": {"enabled": False}},
            "transport": {"shared_memory": {"enabled": False}},
        }
        router = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        try:
            yield endpoint
        finally:
            close_session(router)


_log: Final = logging.getLogger(__name__)

CHECKED_S: Final = 15.0
"""Interval at which a client without a link looks whether a router takes one."""

TAKEN: Final = 2
"""Links taken in a row after which Zenoh has given up: in between it tries about once a second."""


SETTLED_S: Final = 1.5
"""How much longer than the lease it takes until routers have taken back what a lost one had told them."""


class LostLink:
    """Notices that Zenoh (1.10) has given up on a lost link, as it does on one that is closed as it comes up.

    And mends what it does after a move to another router: that one may go on saying that somebody subscribes to what
    the lost router subscribed to on behalf of others, for as long as the link lives, and large frames are sent to it.

    due_s: when to look again, by `time.monotonic`; None while there is a link that is settled, or none that Zenoh is to
    replace.
    """

    def __init__(self, settings: BusSettings) -> None:
        self._settings = settings
        self._taken = 0
        self._router = ""
        self._moved = False
        self.due_s: float | None = None

    def begin(self) -> None:
        """Note that there is no link."""
        self._taken = 0
        self.due_s = time.monotonic() + CHECKED_S if self._settings.is_listening_client else None

    def made(self, router: str) -> None:
        """Note that there is a link. router: the endpoint at its other end."""
        self._moved |= self._settings.is_listening_client and self._router not in ("", router)
        self._router = router
        settled_s = self._settings.lease_s + uniform(SETTLED_S, 2 * SETTLED_S)  # noqa: S311 - no secret; not all at once
        self.due_s = time.monotonic() + settled_s if self._moved else None

    def settle(self, declared: Iterable[Declaration]) -> None:
        """Have the router look again at who wants what is published, if there was a move; returns at once."""
        keys = [each.number_of for each in declared if isinstance(each, MessageWriter) and each.wanted]
        if self._moved and keys:
            work = partial(_look_again, self._settings, self._router, keys)
            threading.Thread(target=work, name="session-settling", daemon=True).start()
        self.end()

    def end(self) -> None:
        """Note that there is no session, or nothing more to do about its link."""
        self._moved = False
        self.due_s = None

    def is_given_up(self) -> bool:
        """Return whether routers take links and Zenoh makes none. Blocks for up to two seconds for each endpoint."""
        taken = any(not why_not_taken(self._settings, endpoint, own=False) for endpoint in self._settings.connect)
        self._taken = self._taken + 1 if taken else 0
        self.due_s = time.monotonic() + CHECKED_S
        return self._taken >= TAKEN


def _look_again(settings: BusSettings, router: str, keys: Collection[str]) -> None:
    """Have the routers that may be at the other end of the link look again at who subscribes to keys."""
    try:
        answered = [subscribe_briefly(settings, each, keys) for each in settings.connect if fits(each, router)]
    except Exception:  # noqa: BLE001 - the link itself is well
        _log.exception("the router at %s was not asked again who wants what", router)
        return
    if not any(answered):
        _log.warning("streams that nobody wants may be sent to %s: it takes no second link", router)
