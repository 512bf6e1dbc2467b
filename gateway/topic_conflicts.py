"""Checks that a gateway uses each ROS topic once. Pure."""

from collections.abc import Iterable


def check_uses(uses: Iterable[tuple[str, str]]) -> None:
    """Check that no topic has two uses; each use is a topic and its description.

    Raises:
        ValueError: naming both uses and the topic.
    """
    known: dict[str, str] = {}
    for topic, use in uses:
        if topic in known:
            raise ValueError(f"{known[topic]} and {use} would both be {topic}: a ROS topic can have only one use")
        known[topic] = use
