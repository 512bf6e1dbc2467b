from gateway.doctor.topic_probe import KEPT, KEPT_BYTES, MAX_MESSAGES, TopicProbe
from gateway.ros1.messages import message_type
from gateway.ros1.wire.tcpros import PublisherAccepted
from gateway.to_bus.translators import kind_of
from schemas.camera_info import CameraInfo
from schemas.keys import sensor_key
from tests.gateway.sensing import STAMP_NS, camera_info

KEY = sensor_key("r1", "front/info")
INFO = message_type("sensor_msgs/CameraInfo")
ACCEPTED = PublisherAccepted("/camera", INFO.topic_type, INFO.definition, latching=True)
DATA = memoryview(camera_info().data)


def test_what_was_heard() -> None:
    probe = TopicProbe("http://robot:1/")
    probe.accepted(ACCEPTED)
    probe.hear(DATA, 1.0, STAMP_NS + 5)
    probe.hear(DATA, 1.5, STAMP_NS + 7)
    heard = probe.heard(KEY, kind_of(KEY), 9)
    assert (heard.arrivals_s, heard.size, heard.rate_hz) == ((1.0, 1.5), len(DATA), 2.0)
    assert (heard.stamps_ns, heard.lags_ns) == ((STAMP_NS, STAMP_NS), (5, 7))
    assert isinstance(heard.message, CameraInfo)
    assert heard.unreadable == ""


def test_stamps_are_found_where_the_publisher_sends_no_definition() -> None:
    probe = TopicProbe("http://robot:1/")
    probe.accepted(PublisherAccepted("/camera", INFO.topic_type, "", latching=False))
    probe.hear(DATA, 1.0, STAMP_NS + 5)
    assert probe.heard(KEY, kind_of(KEY), 9).stamps_ns == (STAMP_NS,)


def test_one_message_has_no_rate_and_none_is_nothing() -> None:
    probe = TopicProbe("http://robot:1/")
    probe.accepted(ACCEPTED)
    assert probe.heard(KEY, kind_of(KEY), 0).message is None
    probe.hear(DATA, 1.0, STAMP_NS)
    assert probe.heard(KEY, kind_of(KEY), 0).rate_hz is None


def test_what_is_kept_is_bounded() -> None:
    probe = TopicProbe("http://robot:1/")
    probe.accepted(ACCEPTED)
    for n in range(MAX_MESSAGES + 5):
        assert probe.full == (n >= MAX_MESSAGES)
        probe.hear(DATA, n / 10, STAMP_NS)
    assert len(probe.arrivals_s) == MAX_MESSAGES


def test_the_first_few_messages_are_kept() -> None:
    probe = TopicProbe("http://robot:1/")
    probe.accepted(ACCEPTED)
    for n in range(KEPT + 1):
        probe.hear(DATA, n / 10, STAMP_NS)
    assert len(probe.heard(KEY, kind_of(KEY), 0).messages) == KEPT


def test_of_large_messages_only_the_first_is_kept() -> None:
    probe = TopicProbe("http://robot:1/")
    probe.accepted(ACCEPTED)
    for n in range(2):
        probe.hear(memoryview(bytes(KEPT_BYTES)), n / 10, STAMP_NS)
    assert len(probe.kept) == 1


def test_a_message_too_short_for_its_stamp_is_heard_all_the_same() -> None:
    probe = TopicProbe("http://robot:1/")
    probe.accepted(ACCEPTED)
    probe.hear(memoryview(bytes(3)), 0.0, 0)
    heard = probe.heard(KEY, kind_of(KEY), 0)
    assert (heard.arrivals_s, heard.stamps_ns, heard.message) == ((0.0,), (), None)
    assert "not a sensor_msgs/CameraInfo" in heard.unreadable
