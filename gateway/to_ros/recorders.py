"""Warns of ROS nodes that subscribe to everything, as `rosbag record -a` does, and so request every result."""

import logging
from collections.abc import Callable
from contextlib import aclosing

from gateway.ros1.node import Node
from gateway.to_ros.outputs import cure, recorders, results_of

log = logging.getLogger(__name__)


async def warn_of_recorders(node: Node, passive: Callable[[str], bool]) -> None:
    """Log each node that subscribes to all results once, forever. passive: whether a node requests none."""
    said: set[str] = set()
    async with aclosing(node.looks()) as looks:
        async for look in looks:
            topics = results_of(look.node, look.state.publishers)
            found = recorders(topics, look.state.subscribers)
            for recorder in found:
                if recorder not in said:
                    _say(recorder, len(topics), passive=passive(recorder))
            said = set(found)


def _say(recorder: str, count: int, *, passive: bool) -> None:
    if passive:
        log.info("%s subscribes to all %d results; it is passive, so it makes none of them wanted", recorder, count)
        return
    log.warning(
        "%s subscribes to all %d results, as `rosbag record -a` does, so workers make all of them of every camera; %s",
        recorder,
        count,
        cure(recorder),
    )
