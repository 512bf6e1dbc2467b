"""An in-memory bus for tests: it follows `bus.api` without threads or sockets, and loses no message."""

import asyncio
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import TypeVar

from bus.api import (
    DEFAULT_ENCODING,
    Bus,
    Handler,
    Latest,
    Publisher,
    QoS,
    Queue,
    Reply,
    Request,
    Subscription,
    Watch,
)
from bus.delivery.reading import PresenceReader, SampleReader
from bus.delivery.split_payload import Payload
from bus.delivery.writing import MessageWriter
from bus.demand import Demand
from bus.errors import BusClosedError
from bus.keys import key_expression, matches, single_key
from bus.requests.pending_request import PendingRequest, Unanswered
from bus.requests.serving import Call, Server, check_free
from bus.session.link_use import MAX_LINKS, LinkUse


class _FakeToken:
    def __init__(self, key: str) -> None:
        self.key = key

    def end(self) -> None:
        """Do nothing: a presence has no reader."""


class _FakeSubscription(SampleReader):
    def __init__(self, key_expr: str, keep: Latest | Queue, loop: asyncio.AbstractEventLoop, *, history: int) -> None:
        super().__init__(keep, loop)
        self.key = key_expr
        self.history = history


class _FakeWatch(PresenceReader):
    def __init__(self, key_expr: str, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__(loop)
        self.key = key_expr


class _FakePublisher(MessageWriter):
    def __init__(self, key: str, qos: QoS, encoding: str, demand: Demand, network: "FakeNetwork", *, kept: int) -> None:
        super().__init__(key, demand, self._deliver)
        self.key = key
        self.encoding = encoding
        self.demand = demand
        self.kept: deque[bytes] = deque(maxlen=0 if qos in (QoS.IMAGE, QoS.MESSAGE) else kept)
        self._network = network

    def _deliver(self, payload: Payload) -> None:
        sent = bytes(payload)
        self.kept.append(sent)
        for subscription in self._network.matching(self.key, _FakeSubscription):
            subscription.arrive(self.key, sent, self.encoding)


_Handle = _FakeToken | _FakeSubscription | _FakeWatch | _FakePublisher | Server
H = TypeVar("H", _FakeToken, _FakeSubscription, _FakeWatch, _FakePublisher, Server)


class FakeNetwork:
    """The network that connects fake buses."""

    def __init__(self) -> None:
        self._handles: list[_Handle] = []

    @asynccontextmanager
    async def open_bus(self, certificate: str = "") -> AsyncIterator[Bus]:
        """Open a bus on this network; leaving closes it. certificate: its name, if it has one."""
        bus = _FakeBus(self, certificate)
        try:
            yield bus
        finally:
            bus.close()

    def matching(self, key_expr: str, kind: type[H]) -> list[H]:
        """Return the declarations of a kind that match a key expression."""
        return [handle for handle in self._handles if isinstance(handle, kind) and matches(handle.key, key_expr)]

    def add(self, handle: _Handle) -> None:
        """Add a declaration and notify matching ones."""
        self._handles.append(handle)
        match handle:
            case _FakeSubscription():
                for publisher in self.matching(handle.key, _FakePublisher):
                    for payload in list(publisher.kept)[-handle.history :] if handle.history else []:
                        handle.arrive(publisher.key, payload, publisher.encoding, kept=True)
            case _FakeWatch():
                for token in self.matching(handle.key, _FakeToken):
                    handle.arrive(token.key, alive=True)
            case _FakeToken():
                self._tell_watches(handle.key, alive=True)
            case _FakePublisher() | Server():
                pass
        self._tell_publishers()

    def remove(self, handle: _Handle) -> None:
        """Remove a declaration and notify matching ones."""
        self._handles.remove(handle)
        if isinstance(handle, _FakeToken):
            self._tell_watches(handle.key, alive=False)
        self._tell_publishers()

    def ask(self, asking: PendingRequest) -> None:
        """Pass a request to one of the key's servers."""

        def answer(outcome: Reply | str | None) -> None:
            match outcome:
                case Reply(payload, encoding):
                    asking.settle(Reply(bytes(payload), encoding))
                case str():
                    asking.refuse(outcome)
                case None:
                    asking.give_up()

        servers = self.matching(asking.key, Server)
        if not servers:
            answer(None)
            return
        request = Request(asking.key, bytes(asking.payload), asking.encoding, time.time_ns())
        servers[0].arrive(Call(request, time.monotonic() + asking.timeout_s, answer))

    def _tell_watches(self, key: str, *, alive: bool) -> None:
        for watch in self.matching(key, _FakeWatch):
            watch.arrive(key, alive=alive)

    def _tell_publishers(self) -> None:
        for publisher in self.matching("**", _FakePublisher):
            publisher.demand.offer(wanted=bool(self.matching(publisher.key, _FakeSubscription)))


class _FakeBus:
    def __init__(self, network: FakeNetwork, certificate: str) -> None:
        self._network = network
        self._certificate = certificate
        self._loop = asyncio.get_running_loop()
        self._handles: list[_Handle] = []
        self._asking = Unanswered()
        self._closed = False

    @property
    def link_problem(self) -> str:
        return "the bus is closed" if self._closed else ""

    @property
    def certificate(self) -> str:
        return self._certificate

    @property
    def links(self) -> LinkUse:
        return LinkUse(0, MAX_LINKS)

    def publisher(
        self,
        key: str,
        qos: QoS,
        /,
        *,
        encoding: str = DEFAULT_ENCODING,
        kept: int = 1,
        on_demand: Callable[[bool], None] | None = None,
    ) -> AbstractAsyncContextManager[Publisher]:
        demand = Demand(self._loop, on_demand)
        return self._held(lambda: _FakePublisher(single_key(key), qos, encoding, demand, self._network, kept=kept))

    def subscribe(
        self,
        key_expr: str,
        keep: Latest | Queue,
        /,
        *,
        history: bool = True,
        recover: int = 1,
        few: bool = False,  # noqa: ARG002 - everything comes at once here
    ) -> AbstractAsyncContextManager[Subscription]:
        last = recover if history else 0
        return self._held(lambda: _FakeSubscription(key_expression(key_expr), keep, self._loop, history=last))

    def watch(
        self,
        key_expr: str,
        /,
        *,
        few: bool = False,  # noqa: ARG002 - everything comes at once here
    ) -> AbstractAsyncContextManager[Watch]:
        return self._held(lambda: _FakeWatch(key_expression(key_expr), self._loop))

    @asynccontextmanager
    async def serve(
        self, key_expr: str, handler: Handler, /, *, at_once: int = 1, waiting: int = 16
    ) -> AsyncIterator[None]:
        def make() -> Server:
            server = Server(key_expression(key_expr), handler, self._loop, at_once, waiting)
            check_free(server.key, self._handles)
            return server

        async with self._held(make) as server, server.serving():
            yield

    async def request(
        self, key: str, payload: bytes | bytearray = b"", /, *, encoding: str = DEFAULT_ENCODING, timeout_s: float
    ) -> Reply:
        if self._closed:
            raise BusClosedError("the bus is closed")
        asking = PendingRequest(single_key(key), payload, encoding, timeout_s)
        with self._asking.holding(asking):
            self._network.ask(asking)
            return await asking.answered()

    @asynccontextmanager
    async def announce(self, key: str, /) -> AsyncIterator[None]:
        async with self._held(lambda: _FakeToken(single_key(key))):
            yield

    def close(self) -> None:
        self._closed = True
        for handle in list(self._handles):
            self._drop(handle)
        self._asking.end()

    @asynccontextmanager
    async def _held(self, make: Callable[[], H]) -> AsyncIterator[H]:
        if self._closed:
            raise BusClosedError("the bus is closed")
        handle = make()
        self._handles.append(handle)
        self._network.add(handle)
        try:
            yield handle
        finally:
            self._drop(handle)

    def _drop(self, handle: _Handle) -> None:
        if handle in self._handles:
            self._handles.remove(handle)
            handle.end()
            self._network.remove(handle)
