import struct

import pytest

from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.stream import MALFORMED, StreamForward
from schemas.header import MAX_LABEL
from schemas.transforms import MAX_TRANSFORMS, Transform, Transforms
from tests.gateway.sensing import STAMP_NS, received, tf, transform
from tests.gateway.to_bus.translators.translating import dropped, forward, translated


def children(stream: StreamForward, message: Message) -> dict[str, float]:
    """Return how far in x every child is that the stream now tells of."""
    sent = stream.take(message, 99)
    assert isinstance(sent, Transforms)
    return {found.child_frame_id: found.translation[0] for found in sent.transforms}


@pytest.mark.parametrize("name", ["tf", "tf_static"])
def test_a_transform_arrives_whole(name: str) -> None:
    made = translated(Transforms, name, tf(transform("lens", parent="base_link", x=1.5)))
    assert (made.header.robot, made.header.camera, made.header.stamp_ns) == ("r1", "", 0)
    assert made.transforms == [
        Transform(
            frame_id="base_link",
            child_frame_id="lens",
            stamp_ns=STAMP_NS,
            translation=(1.5, 2.0, 3.0),
            rotation=(0.0, 0.0, 0.6, 0.8),
        )
    ]


def test_moving_transforms_are_told_message_by_message() -> None:
    stream = forward("tf")
    assert children(stream, tf(transform("a"), transform("b"))) == {"a": 0, "b": 0}
    assert children(stream, tf(transform("c"))) == {"c": 0}
    assert children(stream, tf()) == {}


def test_static_transforms_of_all_publishers_are_told_whole() -> None:
    stream = forward("tf_static")
    assert children(stream, tf(transform("a"), callerid="/one")) == {"a": 0}
    assert children(stream, tf(transform("b"), callerid="/two")) == {"a": 0, "b": 0}
    assert children(stream, tf(transform("a", x=5), callerid="/one")) == {"a": 5, "b": 0}
    assert children(stream, tf(transform("c"), callerid="/one")) == {"a": 5, "b": 0, "c": 0}


@pytest.mark.parametrize("name", ["tf", "tf_static"])
def test_the_type_goes_by_its_older_name_too(name: str) -> None:
    made = translated(Transforms, name, tf(transform("lens", x=1.5), name="tf/tfMessage"))
    assert [found.translation for found in made.transforms] == [(1.5, 2.0, 3.0)]


def test_static_transforms_are_told_whole_whatever_their_type_is_called() -> None:
    stream = forward("tf_static")
    assert children(stream, tf(transform("a"), callerid="/one")) == {"a": 0}
    assert children(stream, tf(transform("b"), callerid="/two", name="tf/tfMessage")) == {"a": 0, "b": 0}
    assert children(stream, tf(transform("c"), callerid="/one")) == {"a": 0, "b": 0, "c": 0}


def test_a_new_subscription_begins_with_nothing_of_publishers_that_have_gone() -> None:
    stream = forward("tf_static")
    children(stream, tf(transform("gone"), callerid="/one"))
    children(stream, tf(transform("gone too"))._replace(uri="http://robot:2/"))
    stream.begin()
    assert children(stream, tf(transform("a"))) == {"a": 0}


def test_what_a_publisher_said_in_an_earlier_subscription_counts_once_it_is_heard_again() -> None:
    stream = forward("tf_static")
    for child in ("camera", "lidar"):
        children(stream, tf(transform(child), callerid="/nodelets"))
    children(stream, tf(transform("mast"), callerid="/mast"))
    stream.begin()
    assert children(stream, tf(transform("mast"), callerid="/mast")) == {"mast": 0}
    assert children(stream, tf(transform("lidar", x=1), callerid="/nodelets")) == {"camera": 0, "lidar": 1, "mast": 0}


def test_a_stream_of_another_topic_begins_with_nothing() -> None:
    stream = forward("tf_static")
    children(stream, tf(transform("a")))
    stream.reset()
    assert children(stream, tf(transform("b"))) == {"b": 0}


def many(count: int, prefix: str = "f") -> Message:
    return tf(*(transform(f"{prefix}{number}") for number in range(count)))


def test_the_most_transforms_and_one_more() -> None:
    assert len(translated(Transforms, "tf", many(MAX_TRANSFORMS)).transforms) == MAX_TRANSFORMS
    assert dropped("tf", many(MAX_TRANSFORMS + 1)) == {MALFORMED: 1}
    assert dropped("tf", received("tf2_msgs/TFMessage", struct.pack("<I", 2**32 - 1))) == {MALFORMED: 1}


def test_static_transforms_are_bounded_over_all_messages_and_the_known_ones_stay() -> None:
    stream = forward("tf_static")
    assert len(children(stream, many(MAX_TRANSFORMS))) == MAX_TRANSFORMS
    assert stream.take(many(1, "g"), 0) is None
    assert len(children(stream, many(1))) == MAX_TRANSFORMS


def test_publishers_that_have_gone_take_no_place() -> None:
    stream = forward("tf_static")
    children(stream, many(MAX_TRANSFORMS))
    stream.begin()
    for child in ("a", "b"):
        children(stream, tf(transform(child), callerid="/another"))
    assert children(stream, tf(transform("c"), callerid="/another")) == {"a": 0, "b": 0, "c": 0}


@pytest.mark.parametrize("name", ["tf", "tf_static"])
def test_a_name_that_is_too_long_costs_its_own_transform_alone(name: str, caplog: pytest.LogCaptureFixture) -> None:
    stream = forward(name)
    too_long = "c" * (MAX_LABEL + 1)
    mixed = tf(transform("a"), transform(too_long), transform("b", parent=too_long), transform("c"))
    assert children(stream, mixed) == {"a": 0, "c": 0}
    assert stream.take(tf(transform(too_long)), 99) is None
    assert children(stream, tf(transform("c", x=1))).items() >= {"c": 1}.items()
    status = stream.status(wanted=True, publishers=1, replaced=0, broken_links={})
    assert (status.received, status.forwarded, status.dropped, status.left_out) == (3, 2, {MALFORMED: 1}, 2)
    assert "/topic from /localiser: sent without 2 transforms of frames whose names are longer than 256" in caplog.text


@pytest.mark.parametrize("name", ["tf", "tf_static"])
def test_a_name_that_is_not_utf8_costs_no_transform(name: str) -> None:
    sent = tf(transform("a"), transform("T?r", parent="K?ste"), transform("b"))
    latin = bytes(sent.data).replace(b"K?ste", b"K\xe4ste").replace(b"T?r", b"T\xfcr")
    stream = forward(name)
    assert children(stream, received("tf2_msgs/TFMessage", latin)) == {"a": 0, "T\ufffdr": 0, "b": 0}
    status = stream.status(wanted=True, publishers=1, replaced=0, broken_links={})
    assert (status.forwarded, status.dropped, status.left_out) == (1, {}, 0)


def test_a_frames_name_is_never_cut() -> None:
    longest = transform("c" * MAX_LABEL, parent="p" * MAX_LABEL)
    assert translated(Transforms, "tf", tf(longest)).transforms[0].frame_id == "p" * MAX_LABEL
    assert dropped("tf", tf(transform("c" * (MAX_LABEL + 1)))) == {MALFORMED: 1}
    assert dropped("tf", tf(transform("c", parent="p" * (MAX_LABEL + 1)))) == {MALFORMED: 1}
