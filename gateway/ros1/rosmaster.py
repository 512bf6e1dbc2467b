"""A ROS master in this process: enough for rospy nodes, rostopic and ours."""

from __future__ import annotations

from contextlib import AsyncExitStack
from typing import TYPE_CHECKING, Self

from gateway.ros1.master_api import MasterApi
from gateway.ros1.notifier import NodeNotifier
from gateway.ros1.tasks import TaskScope
from gateway.ros1.xmlrpc_client import XmlRpcClient
from gateway.ros1.xmlrpc_server import XmlRpcServer

if TYPE_CHECKING:
    from types import TracebackType


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
