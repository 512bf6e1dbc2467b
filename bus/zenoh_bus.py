"""The bus on a Zenoh session."""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Future
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from functools import partial
from typing import Final, Protocol, TypeVar

from bus.api import DEFAULT_ENCODING, Bus, Handler, Latest, Publisher, QoS, Queue, Reply, Subscription, Watch
from bus.delivery.inbox import call_soon
from bus.delivery.subscription import HistorySubscription, ZenohSubscription
from bus.demand import Demand
from bus.errors import BusClosedError
from bus.history.keeping import CacheServer
from bus.keys import key_expression, single_key
from bus.presence.listed_tokens import ListedTokens, ZenohWatch
from bus.presence.own_tokens import OwnTokens, ZenohToken
from bus.requests.pending_request import PendingRequest, Unanswered
from bus.requests.serving import check_free
from bus.session.declaration import Declaration
from bus.session.known_keys import KnownKeys
from bus.session.link_use import MOST_FILES, LinkUse, most_links
from bus.session.process_limits import SHAREABLE_BYTES, keep_freed_memory, may_lock, raise_file_limit
from bus.session.publishers_and_servers import Lanes, ZenohPublisher, ZenohServer
from bus.session.session import SessionThread
from bus.settings import BusSettings

CLOSE_DEADLINE_S: Final = 2.0

_log: Final = logging.getLogger(__name__)


class _Handle(Declaration, Protocol):
    def end(self) -> None: ...


H = TypeVar("H", bound=_Handle)


@asynccontextmanager
async def open_bus(settings: BusSettings, *, own_process: bool = True, prefix: str = "") -> AsyncIterator[Bus]:
    """Open the bus; leaving the context closes it within CLOSE_DEADLINE_S, whatever the state of its links.

    A client whose router is not there yet waits for it in the background; so do peers and routers.

    own_process: the process is one of the fleet's, so its limit of open files is raised. That of another program is
    raised only where others connect, since links are open files; Zenoh (1.10) itself raises it for shared memory.
    prefix: `fleet/{robot}` where this process alone speaks for the robot. It then declares together what it publishes,
    keeps and shows under these keys, so that a router has less to do; its own watches do not show what it shows there.

    Raises:
        BusError: an endpoint to listen on is taken or refused, or a file of certificates cannot be used.

    """
    keep_freed_memory()
    files = raise_file_limit() if own_process or not settings.has_one_link else MOST_FILES  # enough for one link
    bus = ZenohBus(_shareable(settings), most_links(files), prefix)
    try:
        await bus.start()
        yield bus
    finally:
        await bus.close()


def _shareable(settings: BusSettings) -> BusSettings:
    if not settings.shared_memory or may_lock(SHAREABLE_BYTES):
        return settings
    _log.info(
        "no shared memory: the process may not lock %d MiB, so frames go through sockets; raise ulimit -l",
        SHAREABLE_BYTES >> 20,
    )
    return settings.model_copy(update={"shared_memory": False})


class ZenohBus:
    """See `bus.api.Bus`. Create and close it on the same running event loop."""

    def __init__(self, settings: BusSettings, links: int, prefix: str) -> None:
        self._loop = asyncio.get_running_loop()
        self._session = SessionThread(settings, links, prefix)
        self._tokens = OwnTokens(prefix, self._later)
        self._caches = CacheServer(prefix, self._tokens)
        self._listed = ListedTokens(prefix, self._later)
        self._known_keys = KnownKeys(self._session.do) if settings.has_one_link else None
        self._shared_memory = settings.shared_memory
        self._certificate = settings.certificate_name
        self._lanes = Lanes()
        self._handles: set[_Handle] = set()
        self._asking = Unanswered()
        self._closed = False

    async def start(self) -> None:
        """Try once to open the session."""
        for each in (self._known_keys, self._tokens, self._caches, self._listed):
            if each is not None:
                self._session.keep(each)
        await asyncio.wrap_future(self._session.open())

    async def close(self) -> None:
        """End every iteration, undeclare everything, close the session."""
        self._closed = True
        for handle in self._handles:
            handle.end()
        self._asking.end()
        await self._settle(self._session.stop(self._lanes.stop))

    @property
    def link_problem(self) -> str:
        """See `bus.api.Bus.link_problem`."""
        return "the bus is closed" if self._closed else self._session.link_problem

    @property
    def certificate(self) -> str:
        """See `bus.api.Bus.certificate`."""
        return self._certificate

    @property
    def links(self) -> LinkUse:
        """See `bus.api.Bus.links`."""
        return self._session.links

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
        """See `bus.api.Bus.publisher`."""
        demand = Demand(self._loop, on_demand)
        return self._held(
            lambda: ZenohPublisher(
                single_key(key),
                qos,
                encoding,
                demand,
                self._lanes,
                caches=self._caches,
                kept=kept,
                shared_memory=self._shared_memory,
            )
        )

    def subscribe(
        self, key_expr: str, keep: Latest | Queue, /, *, history: bool = True, recover: int = 1, few: bool = False
    ) -> AbstractAsyncContextManager[Subscription]:
        """See `bus.api.Bus.subscribe`."""

        def make() -> ZenohSubscription:
            key = key_expression(key_expr)
            if not history:
                return ZenohSubscription(key, keep, self._loop, few=few)
            known = self._known_keys.add if self._known_keys is not None and "*" in key else None
            return HistorySubscription(
                key, keep, self._loop, self._session.do, listed=self._listed, known=known, few=few, recover=recover
            )

        return self._held(make)

    def watch(self, key_expr: str, /, *, few: bool = False) -> AbstractAsyncContextManager[Watch]:
        """See `bus.api.Bus.watch`."""
        return self._held(lambda: ZenohWatch(key_expression(key_expr), self._loop, self._listed, few=few))

    @asynccontextmanager
    async def serve(
        self, key_expr: str, handler: Handler, /, *, at_once: int = 1, waiting: int = 16
    ) -> AsyncIterator[None]:
        """See `bus.api.Bus.serve`."""

        def make() -> ZenohServer:
            server = ZenohServer(key_expression(key_expr), handler, self._session.submit, at_once, waiting)
            check_free(server.key, self._handles)
            return server

        async with self._held(make) as server, server.serving():
            yield

    async def request(
        self, key: str, payload: bytes | bytearray = b"", /, *, encoding: str = DEFAULT_ENCODING, timeout_s: float
    ) -> Reply:
        """See `bus.api.Bus.request`."""
        if self._closed:
            raise BusClosedError("the bus is closed")
        asking = PendingRequest(single_key(key), payload, encoding, timeout_s)
        with self._asking.holding(asking):
            self._session.ask(asking)
            return await asking.answered()

    @asynccontextmanager
    async def announce(self, key: str, /) -> AsyncIterator[None]:
        """See `bus.api.Bus.announce`."""
        async with self._held(lambda: ZenohToken(single_key(key), self._tokens)):
            yield

    @asynccontextmanager
    async def _held(self, make: Callable[[], H]) -> AsyncIterator[H]:
        if self._closed:
            raise BusClosedError("the bus is closed")
        handle = make()
        self._handles.add(handle)
        try:
            declared = self._session.keep(handle)
            if self._session.is_open:
                await asyncio.wrap_future(declared)
            yield handle
        finally:
            self._handles.discard(handle)
            handle.end()
            await self._settle(self._session.drop(handle))

    def _later(self, delay_s: float, call: Callable[[], None]) -> None:
        """Have a call made on the session's thread after a while."""
        if delay_s:
            call_soon(self._loop, partial(self._loop.call_later, delay_s, self._session.do, call))
        else:
            self._session.do(call)

    async def _settle(self, work: Future[None]) -> None:
        """Wait for clean-up on its thread, which continues even if this wait is cancelled or times out."""
        try:
            async with asyncio.timeout(CLOSE_DEADLINE_S):
                await asyncio.shield(asyncio.wrap_future(work))
        except TimeoutError:
            _log.warning("the bus did not close within %.0f s; its thread is abandoned", CLOSE_DEADLINE_S)
