"""Finds topics that must be sampled before planning, since their names do not tell their stream."""

from collections.abc import Collection, Iterable

from gateway.discovery.candidates import READERS, is_unclear, one_of_each_image, shows_colors
from gateway.discovery.plan import DiscoverySettings, Plan, why_not
from gateway.discovery.published_topics import Topic, image_of
from gateway.ros1 import point_cloud as ros_point_cloud
from schemas.keys import Stream, StreamKey


def unclear(topics: Iterable[Topic], settings: DiscoverySettings) -> list[Topic]:
    """Return the usable images that only their pixels identify as colour or depth."""
    if not settings.discover:
        return []
    named = {image_of(topic) for topic in settings.named.values()}
    looked_at = [topic for topic in topics if topic.type in READERS and why_not(topic, settings, named) is None]
    return [topic for topic in one_of_each_image(looked_at)[0] if is_unclear(topic)]


def unclear_clouds(
    topics: Iterable[Topic], settings: DiscoverySettings, made: Plan, doubted: Collection[str] = ()
) -> list[Topic]:
    """Return the clouds that would be the colour of a camera without another, were they known to be pictures.

    Their names promise colours, but do not tell whether the clouds are organised. doubted: names of topics whose
    encodings were known and are to be known anew, although they may be that colour already.
    """
    if not settings.discover:
        return []
    points = {
        source.topic
        for key, source in made.streams.items()
        if isinstance(key, StreamKey)
        and key.stream is Stream.POINTS
        and _may_color(StreamKey(key.camera, Stream.COLOR), source.topic, made, doubted)
        and shows_colors(source.topic)
    }
    return [
        topic
        for topic in topics
        if topic.name in points and topic.type == ros_point_cloud.TYPE_NAME and not topic.encoding
    ]


def _may_color(color: StreamKey, cloud: str, made: Plan, doubted: Collection[str]) -> bool:
    """Return whether a camera has no colour, or one that is made of this cloud and in doubt."""
    taken = made.streams.get(color)
    return taken is None or (taken.topic == cloud and cloud in doubted)
