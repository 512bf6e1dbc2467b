"""Unregisters killed nodes, which the master never forgets, as `rosnode cleanup` does."""

from __future__ import annotations

from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from gateway.ros1.errors import Ros1Error, StatusError
from gateway.ros1.listening import is_loopback
from gateway.ros1.master import MasterClient

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from gateway.ros1.master import SystemState
    from gateway.ros1.xmlrpc.client import XmlRpcClient


async def unregister_dead(name: str, state: SystemState, *, client: XmlRpcClient, master_uri: str) -> bool:
    """Unregister a node's topics if its address refuses connections; return whether it does.

    A node that keeps silent may be cut off and stays, and so does one whose port is another's by now, whose address is
    a loopback's that may be another machine's, or who registered under none.

    Raises:
        CallError, XmlRpcError: the master does not answer as it should.

    """
    master = MasterClient(client, uri=master_uri, caller_id=name)  # unregisters under the dead node's name
    try:
        uri = await master.lookup_node(name)
    except StatusError:
        return False  # it has left in the meantime
    if _is_loopback(uri) and not _is_loopback(master_uri):
        return False
    if not await _refuses(uri, client, caller_id=name):
        return False
    for topic in _topics(name, state.publishers):
        await master.unregister_publisher(topic, uri)
    for topic in _topics(name, state.subscribers):
        await master.unregister_subscriber(topic, uri)
    return True


async def _refuses(uri: str, client: XmlRpcClient, *, caller_id: str) -> bool:
    try:
        await client.call(uri, "getPid", caller_id)
    except Ros1Error as error:
        return isinstance(error.__cause__, ConnectionRefusedError)
    return False


def _is_loopback(uri: str) -> bool:
    try:
        return is_loopback(urlsplit(uri).hostname or "")
    except ValueError:  # another node may register an invalid address
        return False


def _topics(name: str, by_topic: Mapping[str, Collection[str]]) -> list[str]:
    return [topic for topic, nodes in by_topic.items() if name in nodes]
