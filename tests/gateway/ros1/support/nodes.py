"""Nodes that look at their master often and give up soon."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gateway.ros1.node import Node

if TYPE_CHECKING:
    from services.simulator.ros_master.master import RosMaster


def node(name: str, master: RosMaster) -> Node:
    return Node(name, master_uri=master.uri, poll_interval=0.1, timeout=20.0)
