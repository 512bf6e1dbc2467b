from typing import Any

import msgspec
import pytest

from schemas import codec
from schemas.errors import SchemaError
from schemas.objects import MAX_OBJECT_POINTS, RGB_BYTES, XYZ_BYTES, ObjectClouds
from tests.schemas.results import SHAPE, cloud, clouds

POINTS = ((0.0, 0.5, 2.0), (0.25, 0.5, 2.0))


def decode(message: ObjectClouds) -> ObjectClouds:
    return codec.decode(ObjectClouds, codec.encode(message), codec.encoding(ObjectClouds))


def test_points_are_views_into_the_payload() -> None:
    payload = codec.encode(clouds(cloud(*POINTS, rgb=b"rgbRGB")))
    (found,) = codec.decode(ObjectClouds, payload, codec.encoding(ObjectClouds)).objects
    assert (found.count, bytes(found.rgb)) == (2, b"rgbRGB")
    assert found.xyz.obj is payload
    assert found.xyz.cast("f").tolist() == [0, 0.5, 2, 0.25, 0.5, 2]


@pytest.mark.parametrize(
    ("points", "rgb", "reason"),
    [
        ((), b"", "0 bytes are no points"),
        (POINTS, b"rgb", "3 bytes of colour, 2 points need 6"),
        (POINTS, b"rgbRGBrgb", "9 bytes of colour, 2 points need 6"),
    ],
)
def test_colours_are_held_to_points(points: Any, rgb: bytes, reason: str) -> None:
    with pytest.raises(SchemaError, match=reason):
        cloud(*points, rgb=rgb)


@pytest.mark.parametrize("size", [XYZ_BYTES - 1, XYZ_BYTES + 1])
def test_points_are_whole(size: int) -> None:
    with pytest.raises(SchemaError, match=f"{size} bytes are no points of 12"):
        msgspec.structs.replace(cloud(POINTS[0]), xyz=memoryview(bytes(size)))


def test_points_are_bounded_all_objects_together() -> None:
    half = MAX_OBJECT_POINTS // 2
    large = msgspec.structs.replace(
        cloud(POINTS[0]), xyz=memoryview(bytes(half * XYZ_BYTES)), rgb=memoryview(bytes(half * RGB_BYTES))
    )
    assert len(decode(clouds(large, large)).objects) == 2
    with pytest.raises(SchemaError, match=f"{MAX_OBJECT_POINTS + 1} points, at most {MAX_OBJECT_POINTS}"):
        clouds(large, large, cloud(POINTS[0]))


def test_shapes_are_in_a_target_frame_if_and_only_if_there_is_one() -> None:
    seen = clouds(cloud(*POINTS))
    with pytest.raises(SchemaError, match="if and only if"):
        msgspec.structs.replace(seen, target=None)
    bare = msgspec.structs.replace(cloud(*POINTS), in_target=None)
    without = decode(msgspec.structs.replace(seen, target=None, objects=[bare], unknown_target="no transform"))
    assert without.unknown_target == "no transform"
    with pytest.raises(SchemaError, match="if and only if"):
        msgspec.structs.replace(seen, objects=[bare])


@pytest.mark.parametrize(
    ("part", "wrong"),
    [("size", [-0.1, 1, 1]), ("yaw", 3.15), ("yaw", float("nan")), ("centre", [float("inf"), 0, 0])],
)
def test_boxes_are_finite(part: str, wrong: object) -> None:
    fields = msgspec.to_builtins(clouds(cloud(*POINTS)), builtin_types=(memoryview,))
    fields["objects"][0]["shape"]["box"][part] = wrong
    with pytest.raises(SchemaError, match=part):
        codec.decode(ObjectClouds, msgspec.msgpack.encode(fields), codec.encoding(ObjectClouds))


def test_a_box_stands_along_z_unless_it_says_otherwise() -> None:
    assert SHAPE.box.up == (0, 0, 1)
