"""Asks ROS's XML-RPC servers so that they can keep up."""

import asyncio
from dataclasses import dataclass, field
from typing import Any

from gateway.ros1.errors import UnreachableError
from gateway.ros1.xmlrpc_client import XmlRpcClient


@dataclass(slots=True)
class _Peer:
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    silence: UnreachableError | None = None


class PoliteClient(XmlRpcClient):
    """Asks each server one thing at a time, and none again that did not answer.

    Python's ROS nodes keep five callers waiting and drop the others, who then notice nothing for a second.
    """

    def __init__(self, *, timeout: float) -> None:
        super().__init__(timeout=timeout)
        self._peers: dict[str, _Peer] = {}

    async def call(self, uri: str, method: str, *params: Any) -> Any:
        """See `XmlRpcClient.call`."""
        peer = self._peers.setdefault(uri, _Peer())
        async with peer.turn:
            if peer.silence is not None:
                raise UnreachableError(str(peer.silence)) from peer.silence.__cause__
            try:
                return await super().call(uri, method, *params)
            except UnreachableError as error:
                peer.silence = error
                raise
