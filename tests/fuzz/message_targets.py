"""Messages: ROS's own by type, what streams make of them, and the fleet's own by schema."""

from __future__ import annotations

import struct
from functools import partial
from random import Random
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from gateway.ros1.errors import MessageError
from gateway.ros1.image import Image, decode_image, encode_image
from gateway.ros1.messages import deserialise, serialise
from gateway.ros1.msg.definition import MOMENTS, NUMBERS, STRING
from gateway.ros1.msg.known_messages import DEFINITIONS
from gateway.ros1.point_cloud import decode_point_cloud
from schemas import codec
from schemas.errors import SchemaError
from tests.fuzz.odd_values import something
from tests.fuzz.target import LeftOutError, Target
from tests.gateway import sensing
from tests.gateway.ros1.golden.messages import IMAGE
from tests.gateway.ros1.msg.building import built
from tests.gateway.to_bus.translators.rvl_coding import rvl_of
from tests.gateway.to_bus.translators.translating import forward
from tests.schemas.pictures import file_of
from tests.schemas.test_codec import MESSAGES

if TYPE_CHECKING:
    from gateway.ros1.msg.definition import Field
    from gateway.ros1.tcpros.subscriber import Message

SEEDS_PER_TYPE = 4


def example(rng: Random, kind: str) -> Any:
    """Return a plain value of a type, see `building`."""
    if kind == "bool":
        return rng.random() < 0.5
    if kind in NUMBERS:
        return rng.random() * 100 if kind.startswith("float") else rng.randrange(100)
    if kind in MOMENTS:
        return (rng.randrange(2**31), rng.randrange(10**9))
    if kind == STRING:
        return "ä" * rng.randrange(3) + "x" * rng.randrange(12)
    return {field.name: _field(rng, field) for field in DEFINITIONS[kind].fields}


def _field(rng: Random, field: Field) -> Any:
    if not field.is_array:
        return example(rng, field.type)
    count = rng.randrange(4) if field.length is None else field.length
    return [example(rng, field.type) for _ in range(count)]


def feed_message(name: str, data: bytes, _rng: Random) -> None:
    once = serialise(name, deserialise(name, data))
    assert serialise(name, deserialise(name, once)) == once


def feed_image(data: bytes, _rng: Random) -> None:
    encode_image(decode_image(data))


def feed_points(data: bytes, _rng: Random) -> None:
    decode_point_cloud(data)


def feed_stream(name: str, sent: Message, data: bytes, _rng: Random) -> None:
    stream = forward(name)
    made = stream.take(sensing.received(sent.publisher.type.name, data), 0)
    if made is None:
        raise LeftOutError
    codec.decode(stream.kind.schema, codec.encode(made), stream.kind.encoding)


def feed_schema(schema: type[codec.Message], data: bytes, _rng: Random) -> None:
    encoding = codec.encoding(schema)
    once = codec.encode(codec.decode(schema, data, encoding))
    assert codec.encode(codec.decode(schema, once, encoding)) == once


def messages_of(name: str) -> list[bytes]:
    rng = Random(name)  # noqa: S311 - no secret
    return [serialise(name, built(DEFINITIONS, name, example(rng, name))) for _ in range(SEEDS_PER_TYPE)]


def payloads_of(schema: type[codec.Message]) -> list[bytes]:
    own = [codec.encode(message) for message in MESSAGES if type(message) is schema]
    return own or [codec.encode(message) for message in MESSAGES]


def odd_fields(schema: type[codec.Message], rng: Random) -> bytes:
    """Return a payload whose fields, or those of its parts, have other values."""
    fields = msgspec.msgpack.decode(rng.choice(payloads_of(schema)))
    for _ in range(rng.randrange(1, 3)):
        _put_something_odd(fields, rng)
    return msgspec.msgpack.encode(fields)


def _put_something_odd(inside: Any, rng: Random) -> None:
    keys = list(inside) if isinstance(inside, dict) else range(len(inside))
    if not keys:
        return
    key = rng.choice(keys)
    if isinstance(inside[key], dict | list) and rng.random() < 0.6:
        _put_something_odd(inside[key], rng)
    else:
        inside[key] = something(rng)


GREY = np.zeros((2, 3), np.uint8)
MILLIMETRES = np.zeros((2, 3), np.uint16)
DEPTH = Image(1, 2, 3, "lens", 2, 3, "16UC1", is_bigendian=False, step=6, data=memoryview(bytes(12)))
STREAMS: list[tuple[str, Message]] = [
    ("front/color", sensing.received("sensor_msgs/Image", IMAGE[4:])),
    ("front/color", sensing.compressed("rgb8; jpeg compressed bgr8", file_of(GREY, ".jpg"))),
    ("front/depth", sensing.received("sensor_msgs/Image", encode_image(DEPTH))),
    (
        "front/depth",
        sensing.compressed("32FC1; compressedDepth", struct.pack("<iff", 0, 1, 2) + file_of(MILLIMETRES, ".png")),
    ),
    ("rear/depth", sensing.compressed("16UC1; compressedDepth rvl", bytes(12) + rvl_of(MILLIMETRES + 5))),
    ("front/depth", sensing.disparity(np.ones((2, 3), np.float32))),
    ("front/info", sensing.camera_info()),
    ("front/points", sensing.point_cloud()),
    ("text/mode", sensing.text("ready")),
    ("ros/mode", sensing.text("ready")),
    ("tf", sensing.tf(sensing.transform("lens"), sensing.transform("lidar"))),
    ("tf_static", sensing.tf(sensing.transform("lens"), sensing.transform("lidar"))),
]

TARGETS = [
    Target("image", [IMAGE[4:]], feed_image, (MessageError,)),
    Target("point cloud", [bytes(sensing.point_cloud().data)], feed_points, (MessageError,)),
    *(Target(name, messages_of(name), partial(feed_message, name), (MessageError,)) for name in DEFINITIONS),
    *(
        Target(
            f"{name} of {sent.publisher.type.name}",
            [bytes(sent.data)],
            partial(feed_stream, name, sent),
            (LeftOutError,),
        )
        for name, sent in STREAMS
    ),
    *(
        Target(
            schema.__name__,
            payloads_of(schema),
            partial(feed_schema, schema),
            (SchemaError,),
            partial(odd_fields, schema),
        )
        for schema in codec.MAX_BYTES
    ),
]
