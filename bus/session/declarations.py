"""Declarations of the real bus on a Zenoh session: publishers, watches, tokens and servers."""

import asyncio
import time
from asyncio import AbstractEventLoop
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from random import getrandbits
from typing import Any, Final

import zenoh
from zenoh import CongestionControl, Priority, Reliability, ext
from zenoh.handlers import Callback

from bus.api import MAX_REQUEST_BYTES, SMALL_BYTES, SMALL_WAITING, Handler, QoS, Reply, Request
from bus.delivery.batching import taking
from bus.delivery.pieces import Payload, joined
from bus.delivery.reading import PresenceReader
from bus.delivery.shared_memory import SharedFrames
from bus.delivery.writing import Lane, MessageWriter
from bus.demand import Demand
from bus.history.caches import MOST_KEPT, stamp
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
    """A publisher. One that keeps messages has a second, plain one on its key, to learn of matching subscribers."""

    def __init__(
        self,
        key: str,
        qos: QoS,
        encoding: str,
        demand: Demand,
        lanes: Lanes,
        *,
        kept: int,
        shared_memory: bool,
    ) -> None:
        self._lane = lanes.of(qos)
        super().__init__(key, demand, self._offer)
        self._qos = qos
        self._encoding = encoding
        self._kept: deque[tuple[bytes, int]] = deque(maxlen=0 if qos in UNKEPT else min(kept, MOST_KEPT))
        self._name = getrandbits(32)
        self._number = 0
        self._declared = ExitStack()
        self._turn = 0  # of being declared; callbacks compare it, as one with a session would release that at any time
        self._publisher: zenoh.Publisher | ext.AdvancedPublisher | None = None
        self._small: zenoh.Publisher | None = None
        self._shared = SharedFrames() if qos in UNKEPT and shared_memory else None

    @property
    def number_of(self) -> str:
        """See `Declaration`."""
        return self._key

    @property
    def takes_another(self) -> bool:
        """See `Declaration`; caches do."""
        return self._qos not in UNKEPT

    @property
    def kept(self) -> int:
        """Messages kept for subscribers that come late or lost their link."""
        return self._kept.maxlen or 0

    def declare(self, session: zenoh.Session) -> None:
        """Declare on the session's thread, then let the lane write."""
        self._turn += 1
        matching = session.declare_publisher(
            self._key,
            encoding=self._encoding,
            congestion_control=CongestionControl.DROP,
            priority=PRIORITIES[QoS.IMAGE],
            reliability=Reliability.BEST_EFFORT,
        )
        self._declared.callback(matching.undeclare)
        listener = matching.declare_matching_listener(Callback(partial(self._on_matching, self._turn), indirect=False))
        self._declared.callback(listener.undeclare)
        if self._qos is QoS.MESSAGE:
            self._small = self._declare_small(session)
        self._publisher = matching if self._qos in UNKEPT else self._declare_cached(session)
        status: Any = matching.matching_status  # the type stub says bool
        self._demand.offer(wanted=status.matching, initial=True)
        self._lane.admit(self)

    def _declare_small(self, session: zenoh.Session) -> zenoh.Publisher:
        publisher = session.declare_publisher(
            self._key,
            encoding=self._encoding,
            congestion_control=CongestionControl.DROP,
            priority=PRIORITIES[self._qos],
            reliability=Reliability.RELIABLE,
        )
        self._declared.callback(publisher.undeclare)
        return publisher

    def _declare_cached(self, session: zenoh.Session) -> ext.AdvancedPublisher:
        publisher = ext.declare_advanced_publisher(
            session,
            self._key,
            encoding=self._encoding,
            congestion_control=CongestionControl.DROP,
            priority=PRIORITIES[self._qos],
            reliability=Reliability.RELIABLE,
            cache=ext.CacheConfig(self.kept),
            # No heartbeat: undeclaring one can hold the interpreter lock for ten seconds (1.10).
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
            publisher_detection=True,
        )
        self._declared.callback(publisher.undeclare)
        for newness, (payload, number) in zip(range(len(self._kept), 0, -1), self._kept, strict=True):
            with suppress(zenoh.ZError):  # the others are sent
                publisher.put(payload, attachment=stamp(self._name, number, newness))
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
            elif self._qos in UNKEPT:
                self._write_image(self._publisher, payload)
            else:
                self._write_numbered(self._publisher, payload)

    def _write_image(self, publisher: zenoh.Publisher | ext.AdvancedPublisher, payload: Payload) -> None:
        placed = joined(payload) if self._shared is None else self._shared.place(payload)
        if placed is None:
            self.count_dropped(1)
        else:
            publisher.put(placed)

    def _write_numbered(self, publisher: zenoh.Publisher | ext.AdvancedPublisher, payload: Payload) -> None:
        self._number += 1
        whole = bytes(payload)
        self._kept.append((whole, self._number))  # first: what a lost link does not take goes to the next link
        try:
            publisher.put(whole, attachment=stamp(self._name, self._number, 0))
        except zenoh.ZError:
            if not self.kept:
                raise

    def undeclare(self) -> None:
        """Write waiting messages within a short grace period, and undeclare."""
        self._lane.retire(self, RETIRE_GRACE_S)
        try:
            self._declared.close()
        finally:
            self._turn += 1
            self._publisher = self._small = None
            self._demand.forget()


class ZenohWatch(PresenceReader):
    """A watch. Tokens are fetched in batches, since those of a large fleet appear at once."""

    number_of = ""
    takes_another = False

    def __init__(self, key_expr: str, loop: AbstractEventLoop, *, few: bool) -> None:
        super().__init__(loop)
        self._key_expr = key_expr
        self._few = few
        self._present: set[str] = set()
        self._declared = ExitStack()

    def declare(self, session: zenoh.Session) -> None:
        """Declare on the session's thread."""
        declare = partial(session.liveliness().declare_subscriber, self._key_expr, history=True)
        self._declared.enter_context(taking(declare, self._on_changes, together=not self._few))

    def undeclare(self) -> None:
        """Undeclare and report all tokens as vanished: those that end before the next declaration go unnoticed."""
        try:
            self._declared.close()
        finally:
            for key in list(self._present):
                self.arrive(key, alive=False)
            self._present.clear()

    def _on_changes(self, samples: Sequence[zenoh.Sample]) -> None:
        for sample in samples:
            key, alive = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
            (self._present.add if alive else self._present.discard)(key)
            self.arrive(key, alive=alive)


class ZenohToken:
    """A presence token."""

    number_of = ""
    takes_another = False

    def __init__(self, key: str) -> None:
        self._key = key
        self._token: zenoh.LivelinessToken | None = None

    def declare(self, session: zenoh.Session) -> None:
        """Declare on the session's thread."""
        self._token = session.liveliness().declare_token(self._key)

    def undeclare(self) -> None:
        """Undeclare."""
        if self._token is not None:
            self._token.undeclare()

    def end(self) -> None:
        """Do nothing: a presence has no reader."""


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
