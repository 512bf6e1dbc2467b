"""Declarations of the real bus on a Zenoh session: publishers and servers."""

import asyncio
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any, Final

import zenoh
from zenoh import CongestionControl, Priority, Reliability
from zenoh.handlers import Callback

from bus.api import MAX_REQUEST_BYTES, SMALL_BYTES, SMALL_WAITING, Handler, QoS, Reply, Request
from bus.delivery.shared_memory import SharedFrames
from bus.delivery.split_payload import Payload, joined
from bus.delivery.writing import Lane, MessageWriter
from bus.demand import Demand
from bus.history.keeping import CacheServer, KeptMessages
from bus.requests.queries import TIMEOUT_MS, finish_query, timeout_of
from bus.requests.serving import Call, Server
from bus.session.known_keys import number_of
from bus.session.panics import panics_are_errors

IMAGES_WAITING: Final = 1
RESULTS_WAITING: Final = 64
RETIRE_GRACE_S: Final = 1.0
STOP_GRACE_S: Final = 0.2
UNKEPT: Final = (QoS.IMAGE, QoS.MESSAGE)
"""Qualities of service that keep no message for late subscribers."""

PRIORITIES: Final = {
    QoS.IMAGE: Priority.DATA_LOW,
    QoS.MESSAGE: Priority.DATA,
    QoS.LATCHED: Priority.DATA_LOW,
    QoS.RESULT: Priority.INTERACTIVE_HIGH,
    QoS.STATUS: Priority.DATA,
}


class Lanes:
    """The sending threads: small messages have their own, so that they never wait behind a large one."""

    def __init__(self) -> None:
        self.images = Lane("images", IMAGES_WAITING)
        self.results = Lane("results", RESULTS_WAITING)

    def of(self, qos: QoS) -> Lane:
        """Return the lane for a quality of service."""
        return self.images if qos in (QoS.IMAGE, QoS.MESSAGE, QoS.LATCHED) else self.results

    def stop(self) -> None:
        """End the threads."""
        self.images.stop(STOP_GRACE_S)
        self.results.stop(STOP_GRACE_S)


class ZenohPublisher(MessageWriter):
    """A publisher.

    caches: where the messages that it keeps can be had.
    """

    def __init__(
        self,
        key: str,
        qos: QoS,
        encoding: str,
        demand: Demand,
        lanes: Lanes,
        *,
        caches: CacheServer,
        kept: int,
        shared_memory: bool,
    ) -> None:
        self._lane = lanes.of(qos)
        super().__init__(key, demand, self._offer)
        self._qos = qos
        self._encoding = encoding
        self._kept = None if qos in UNKEPT or not kept else caches.ended.messages(key, encoding, kept)
        self._caches = caches
        self._declared = ExitStack()
        self._turn = 0  # of being declared; callbacks compare it, as one with a session would release that at any time
        self._publisher: zenoh.Publisher | None = None
        self._small: zenoh.Publisher | None = None
        self._shared = SharedFrames() if qos in UNKEPT and shared_memory else None

    def end(self) -> None:
        """See `MessageWriter.end`. The next publisher on its key takes over its kept messages."""
        super().end()
        if self._kept is not None:
            self._caches.ended.add(self._kept)

    @property
    def number_of(self) -> str:
        """See `Declaration`."""
        return self._key

    @property
    def takes_another(self) -> bool:
        """See `Declaration`; caches do."""
        return self._kept is not None

    @property
    def kept(self) -> int:
        """Messages kept for subscribers that come late or lost their link."""
        return 0 if self._kept is None else self._kept.most

    def declare(self, session: zenoh.Session) -> None:
        """Declare on the session's thread, then let the lane write."""
        self._turn += 1
        if self._kept is not None:
            self._declared.callback(self._caches.add(self._kept))
        publisher = self._declare(session, reliable=self._qos not in UNKEPT)
        if self._qos is QoS.MESSAGE:
            self._small = self._declare(session, reliable=True)
        listener = publisher.declare_matching_listener(Callback(partial(self._on_matching, self._turn), indirect=False))
        self._declared.callback(listener.undeclare)
        self._publisher = publisher
        status: Any = publisher.matching_status  # the type stub says bool
        self._demand.offer(wanted=status.matching, initial=True)
        self._lane.admit(self)

    def _declare(self, session: zenoh.Session, *, reliable: bool) -> zenoh.Publisher:
        publisher = session.declare_publisher(
            self._key,
            encoding=self._encoding,
            congestion_control=CongestionControl.DROP,
            priority=PRIORITIES[self._qos if reliable else QoS.IMAGE],
            reliability=Reliability.RELIABLE if reliable else Reliability.BEST_EFFORT,
        )
        self._declared.callback(publisher.undeclare)
        return publisher

    def _on_matching(self, turn: int, status: zenoh.MatchingStatus) -> None:
        if turn == self._turn:
            self._demand.offer(wanted=status.matching)

    def _offer(self, payload: Payload) -> None:
        self._lane.offer(self, payload, SMALL_WAITING if self._is_small(payload) else 0)

    def _is_small(self, payload: Payload) -> bool:
        return self._qos is QoS.MESSAGE and len(payload) <= SMALL_BYTES

    def write(self, payload: Payload) -> None:
        """Send on the lane's thread."""
        if self._publisher is None:
            return
        with panics_are_errors():
            if self._small is not None and self._is_small(payload):
                self._small.put(joined(payload))
            elif self._kept is None:
                self._write_image(self._publisher, payload)
            else:
                self._write_kept(self._publisher, self._kept, bytes(payload))

    def _write_image(self, publisher: zenoh.Publisher, payload: Payload) -> None:
        placed = joined(payload) if self._shared is None else self._shared.place(payload)
        if placed is None:
            self.count_dropped(1)
        else:
            publisher.put(placed)

    def _write_kept(self, publisher: zenoh.Publisher, kept: KeptMessages, payload: bytes) -> None:
        attachment = kept.add(payload)
        with suppress(zenoh.ZError):  # what a lost link does not take is had from the cache
            publisher.put(payload, attachment=attachment)

    def undeclare(self) -> None:
        """Write waiting messages within a short grace period, and undeclare."""
        self._lane.retire(self, RETIRE_GRACE_S)
        try:
            self._declared.close()
        finally:
            self._turn += 1
            self._publisher = self._small = None
            self._demand.forget()


class ZenohServer(Server):
    """A server. Zenoh passes each query to one of the servers of a key, since all declare themselves complete.

    submit: queues a call on the session's thread.
    """

    takes_another = False

    def __init__(
        self,
        key_expr: str,
        handler: Handler,
        submit: Callable[[Callable[[], None]], object],
        at_once: int,
        waiting: int,
    ) -> None:
        super().__init__(key_expr, handler, asyncio.get_running_loop(), at_once, waiting)
        self._submit = submit
        self._session: zenoh.Session | None = None
        self._queryable: zenoh.Queryable[None] | None = None

    @property
    def number_of(self) -> str:
        """See `Declaration`."""
        return number_of(self.key)

    def declare(self, session: zenoh.Session) -> None:
        """Declare on the session's thread."""
        callback = Callback(self._on_query, indirect=False)
        self._session = session
        self._queryable = session.declare_queryable(self.key, callback, complete=True)

    def undeclare(self) -> None:
        """Undeclare."""
        if self._queryable is None or self._session is None:
            return
        self._queryable.undeclare()
        # Otherwise Zenoh (1.10) may keep asking the server that left although others have the key.
        self._session.declare_queryable(
            self.key, Callback(zenoh.Query.drop, indirect=False), complete=False
        ).undeclare()
        self._session = self._queryable = None

    def _on_query(self, query: zenoh.Query) -> None:
        def answer(outcome: Reply | str | None) -> None:
            self._submit(partial(finish_query, query, self.key, outcome))

        size = 0 if query.payload is None else len(query.payload)
        if size > MAX_REQUEST_BYTES:
            answer(f"a request of {size} bytes, at most {MAX_REQUEST_BYTES} are read")
            return
        payload = b"" if query.payload is None else query.payload.to_bytes()
        request = Request(str(query.key_expr), payload, str(query.encoding or ""), time.time_ns())
        until_s = time.monotonic() + timeout_of(query.parameters.get(TIMEOUT_MS))
        self.arrive(Call(request, until_s, answer))
