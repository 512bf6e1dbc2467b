"""What a gateway uses ROS topics for: each has one use. Pure."""

from collections.abc import Iterable


def check_uses(uses: Iterable[tuple[str, str]]) -> None:
    """Check that no topic has two uses, of which each is given as the topic and, in words, what it is.

    Raises:
        ValueError: naming both uses and the topic.
    """
    known: dict[str, str] = {}
    for topic, use in uses:
        if topic in known:
            raise ValueError(f"{known[topic]} and {use} would both be {topic}: a ROS topic can have only one use")
        known[topic] = use
