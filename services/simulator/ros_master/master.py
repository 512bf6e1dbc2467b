"""A ROS master in this process: enough for rospy nodes, rostopic and our own nodes."""

from __future__ import annotations

import logging
from contextlib import AsyncExitStack
from typing import TYPE_CHECKING, Any, Self

from gateway.ros1.errors import CallError, WireError
from gateway.ros1.tasks import TaskScope
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.ros1.xmlrpc.server import XmlRpcServer
from services.simulator.ros_master.api import MasterApi

if TYPE_CHECKING:
    from types import TracebackType

    from gateway.ros1.tasks import TaskScope
    from gateway.ros1.xmlrpc.client import XmlRpcClient


log = logging.getLogger(__name__)


class NodeNotifier:
    """Calls nodes in the order of their first queued call; a newer call of the same kind replaces an older one.

    The number of queued calls is bounded by the number of registrations.
    """

    def __init__(self, client: XmlRpcClient, scope: TaskScope) -> None:
        self._client = client
        self._scope = scope
        self._waiting: dict[str, dict[tuple[str, str], tuple[Any, ...]]] = {}

    def notify(self, uri: str, method: str, key: str, *params: Any) -> None:
        """Queue a call."""
        if uri not in self._waiting:
            self._waiting[uri] = {}
            self._scope.start(self._drain(uri), f"notify {uri}")
        self._waiting[uri][method, key] = params

    async def _drain(self, uri: str) -> None:
        waiting = self._waiting[uri]
        try:
            while waiting:
                (method, key), params = next(iter(waiting.items()))
                del waiting[method, key]
                await self._call(uri, method, params)
        finally:
            del self._waiting[uri]

    async def _call(self, uri: str, method: str, params: tuple[Any, ...]) -> None:
        try:
            await self._client.call(uri, method, "/master", *params)
        except (CallError, WireError) as error:
            log.info("%s did not accept %s: %s", uri, method, error)


class RosMaster:
    """Enter it to serve; port 0 takes a free one.

    Raises:
        OSError: the port is taken.

    """

    def __init__(self, *, host: str = "127.0.0.1", port: int = 0) -> None:
        self._scope = TaskScope()
        self._client = XmlRpcClient()
        self._api = MasterApi(NodeNotifier(self._client, self._scope))
        self._server = XmlRpcServer(self._api, host=host, port=port)
        self._stack = AsyncExitStack()

    @property
    def uri(self) -> str:
        """The master's URI; known once entered."""
        return self._server.uri

    async def __aenter__(self) -> Self:
        async with AsyncExitStack() as stack:
            await stack.enter_async_context(self._client)
            await stack.enter_async_context(self._scope)
            await stack.enter_async_context(self._server)
            self._api.uri = self.uri
            self._stack = stack.pop_all()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self._stack.__aexit__(kind, error, traceback)
