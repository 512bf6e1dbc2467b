from benchmarks.guide.scene import MOVING, SENSORS, STATIC, Scene
from benchmarks.guide.topics import COLOR, DEPTH, POINTS
from gateway.ros1.image import decode_image
from gateway.ros1.messages import deserialise
from gateway.ros1.point_cloud import decode_point_cloud
from services.simulator.topics import Content

NOW_NS = 1_795_000_000_123_456_789


def test_an_instant_has_one_stamp_and_the_guides_topics() -> None:
    scene = Scene(1)
    messages = list(scene.messages(5, NOW_NS))
    assert [topic for topic, _ in messages] == [MOVING, *SENSORS]
    found = {f"/{topic.name}": message for topic, message in messages}
    color, depth = decode_image(found[COLOR]), decode_image(found[DEPTH])
    points = decode_point_cloud(found[POINTS])
    assert (color.height, color.width, color.encoding, color.stamp) == (480, 640, "rgb8", NOW_NS)
    assert (depth.height, depth.width, depth.encoding, depth.stamp) == (480, 640, "16UC1", NOW_NS)
    assert (points.height, points.width, points.stamp) == (480, 640, NOW_NS)
    assert scene.size(Content.COLOR) == len(found[COLOR])
    assert scene.pictures.tobytes() == bytes(color.data)
    assert scene.pictures.shape == (1, 480, 640, 3)
    (moving, *_) = deserialise(MOVING.type, messages[0][1]).transforms
    assert moving.header.stamp.sec * 1_000_000_000 + moving.header.stamp.nanosec == NOW_NS
    assert deserialise(STATIC.type, scene.static(NOW_NS)).transforms
