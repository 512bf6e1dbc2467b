"""What is said of a plan, in lines for people. Pure."""

from collections.abc import Iterator, Mapping
from typing import Final

from gateway.discovery.plan import NOTHING, Plan, Source
from gateway.discovery.topics import is_topic
from schemas.keys import Stream, StreamKey

MAX_LISTED: Final = 12
MAX_SHOWN: Final = 80


def changes(now: Plan, before: Plan = NOTHING) -> list[str]:
    """Return a line for each stream that is new, changed or gone, and for each reason why topics are left out now."""
    return [*_streams(now, before), *_gone(now, before), *_left_out(now.left_out, before.left_out)]


def _streams(now: Plan, before: Plan) -> Iterator[str]:
    for key, source in now.streams.items():
        old = before.streams.get(key)
        if old is None:
            yield f"{key.name}: {_said(source)}"
        elif old.topic != source.topic:
            yield f"{key.name}: {_said(source)} now, no longer {old.topic}"
        elif old.type != source.type:
            yield f"{key.name}: {_said(source)} now"


def _gone(now: Plan, before: Plan) -> Iterator[str]:
    for key in sorted(before.streams.keys() - now.streams.keys(), key=str):
        yield f"{key.name}: no longer offered, {_fate(before.streams[key].topic, now)}"


def _fate(topic: str, now: Plan) -> str:
    """Say what a topic is that was another stream's."""
    user = next((key for key, source in now.streams.items() if source.topic == topic), None)
    if user is None:
        return f"{topic} is {'left out' if topic in now.left_out else 'gone'}"
    of_points = isinstance(user, StreamKey) and user.stream is Stream.POINTS
    return f"{topic} {'has points and no picture' if of_points else f'is {user.name}'}"


def _said(source: Source) -> str:
    return f"{source.topic} ({source.type[:MAX_SHOWN] or 'not known to the ROS master yet'})"


def _left_out(now: Mapping[str, str], before: Mapping[str, str]) -> Iterator[str]:
    by_reason: dict[str, list[str]] = {}
    for topic, reason in now.items():
        if before.get(topic) != reason:
            by_reason.setdefault(reason, []).append(topic)
    for reason, topics in sorted(by_reason.items()):
        more = f" and {len(topics) - MAX_LISTED} more" if len(topics) > MAX_LISTED else ""
        yield f"left out, {reason}: {', '.join(map(_shown, topics[:MAX_LISTED]))}{more}"


def _shown(topic: str) -> str:
    return topic if is_topic(topic) else repr(topic[:MAX_SHOWN])
