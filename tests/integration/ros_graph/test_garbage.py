"""A publisher that sends garbage, beside one that does not, at Debian's real master."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from gateway.ros1.messages import message_type
from gateway.ros1.node import Node
from gateway.ros1.tcpros.subscriber import LinkFailure
from gateway.ros1.wire.header import encode_header
from tests.gateway.ros1.support.fakes import fake_publisher
from tests.integration.peers.rospy_scripts import TALKER
from tests.waiting import until

if TYPE_CHECKING:
    from gateway.ros1.tcpros.subscriber import Message
    from tests.integration.peers.ros import RosEnvironment

STRING = message_type("std_msgs/String")
GOOD_HEADER = encode_header({"type": STRING.name, "md5sum": STRING.md5sum, "callerid": "/garbage"})


@pytest.mark.parametrize(
    ("stream", "failure"),
    [
        pytest.param(b"HTTP/1.1 200 OK\r\n\r\n<html>" * 100, LinkFailure.PROTOCOL, id="not TCPROS"),
        pytest.param(GOOD_HEADER + b"\xff\xff\xff\xff" + bytes(1000), LinkFailure.TOO_LARGE, id="4 GB message"),
        pytest.param(b"\x04\x00\x00\x00\xff\xff\xff\xff", LinkFailure.PROTOCOL, id="field past the header"),
    ],
)
async def test_garbage_is_counted_and_harms_nobody(ros: RosEnvironment, stream: bytes, failure: LinkFailure) -> None:
    got: list[Message] = []
    async with (
        fake_publisher(stream) as uri,
        Node("/ours", master_uri=ros.master_uri) as node,
        Node("/garbage", master_uri=ros.master_uri) as garbage,
        node.subscribe("/chatter", STRING.name, got.append) as subscription,
    ):
        await garbage.master.register_publisher("/chatter", STRING.name, uri)
        await until(lambda: subscription.counters.failures[failure] >= 2, "garbage has come twice")
        await ros.script(TALKER, "talker", "/chatter", "50")
        await until(lambda: len(got) >= 3, "the talker is heard")
        assert subscription.counters.links[uri].failures[failure] >= 2
        assert subscription.counters.links[uri].messages == 0
    assert {message.callerid for message in got} == {"/talker"}
