import pytest

from gateway.topic_conflicts import check_uses


def test_a_topic_has_one_use() -> None:
    check_uses([("/a", "stream front/color"), ("/b", "the alerts")])
    with pytest.raises(
        ValueError, match="stream front/color and the alerts would both be /a: a ROS topic can have only one use"
    ):
        check_uses([("/a", "stream front/color"), ("/b", "action stop"), ("/a", "the alerts")])
