"""Command-line options for advice, complete enough to copy. Pure."""

from typing import Final

from gateway.discovery.published_topics import calibrations_of
from gateway.doctor.evidence import Evidence, StreamLook
from schemas.errors import SchemaError
from schemas.keys import ROS, Stream, sensor_key

_ANY: Final = f"{ROS}/NAME"


def further(stream: str, topic: str, evidence: Evidence) -> str:
    """Return the options that make a topic a stream and keep the present streams.

    Naming one stream by hand ends discovery unless it is asked for.
    """
    return f"{'--discover ' if evidence.discover else ''}--topics {stream}={topic}"


def taking(stream: str, topic: str, evidence: Evidence) -> str:
    """Return the advice that makes a published topic a stream."""
    if why := evidence.left_out.get(topic):
        return f"it is {why}: change that"
    return f"add {further(stream, topic, evidence)}"


def untranslated(stream: StreamLook, evidence: Evidence) -> str:
    """Return the options that forward a stream's topic untranslated, in place of the stream."""
    options = further(raw_name(stream.topic), stream.topic, evidence)
    return f"{options} in place of {stream.name}" if stream.key in evidence.by_hand else options


def raw_name(topic: str) -> str:
    """Return the name of the stream that carries a topic untranslated, as close to the topic's as possible."""
    chunks = [chunk.lstrip("_") for chunk in topic.strip("/").split("/")]
    name = "/".join([ROS, *filter(None, chunks)])
    try:
        sensor_key("robot", name)
    except SchemaError:
        return _ANY
    return name


def calibration_of(camera: str, of: Stream, stream: Stream, evidence: Evidence) -> str:
    """Return the advice that makes the camera info of a camera's images a stream."""
    images = evidence.of(camera, of)
    if evidence.discover and images is not None:
        return f"have the driver publish {calibrations_of(images.topic)[0]}, or remap what it publishes to that name"
    return f"have the driver publish camera_info, and add {further(f'{camera}/{stream}', 'TOPIC', evidence)}"
