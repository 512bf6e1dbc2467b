"""The master's calls back to nodes: each node has its own task, so that a dead one delays nobody."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

from gateway.ros1.errors import CallError, WireError

if TYPE_CHECKING:
    from gateway.ros1.tasks import TaskScope
    from gateway.ros1.xmlrpc_client import XmlRpcClient

log = logging.getLogger(__name__)


class NodeNotifier:
    """Calls every node in the order in which its calls were first queued; a newer call of one kind replaces an older.

    What waits is bounded by the registrations that the calls are about.
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
            log.info("%s did not take %s: %s", uri, method, error)
