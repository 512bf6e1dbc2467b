"""rospy's own nodes and tools over our master."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gateway.ros1.node import Node
from services.simulator.ros_master.master import RosMaster
from tests.integration.peers.ros import RosEnvironment
from tests.integration.peers.rospy_scripts import LISTENER, TALKER
from tests.waiting import until

if TYPE_CHECKING:
    from pathlib import Path

PARAMETERS = """
import rospy
rospy.init_node("parameters")
rospy.set_param("~rate", 5)
rospy.set_param("/robot", {"name": "r1", "limits": {"speed": 0.5}})
print(rospy.get_param("/robot/limits/speed"), rospy.get_param("/parameters/rate"), rospy.has_param("/nothing"),
      rospy.get_param("/nothing", "default"), rospy.search_param("robot"), sorted(rospy.get_param_names()))
rospy.delete_param("/robot/name")
print(rospy.get_param("/robot"), rospy.get_published_topics())
"""


async def test_rospy_talker_and_listener_meet(ros_installed: None, tmp_path: Path) -> None:  # noqa: ARG001
    async with RosMaster() as master, RosEnvironment(tmp_path, master_uri=master.uri) as ros:
        listener = await ros.script(LISTENER, "listener", "/chatter")
        await listener.until_output("listener up")
        await ros.script(TALKER, "talker", "/chatter", "20")
        await listener.until_output("heard talker")
        await ros.script(TALKER, "second", "/chatter", "20")
        await listener.until_output("heard second")


async def test_rospy_parameters(ros_installed: None, tmp_path: Path) -> None:  # noqa: ARG001
    async with RosMaster() as master, RosEnvironment(tmp_path, master_uri=master.uri) as ros:
        output = await (await ros.script(PARAMETERS)).finished()
    assert "0.5 5 False default /robot ['/parameters/rate', '/robot/limits/speed', '/robot/name']" in output
    assert "{'limits': {'speed': 0.5}} [['/rosout', 'rosgraph_msgs/Log']]" in output


async def test_rostopic_and_our_node(ros_installed: None, tmp_path: Path) -> None:  # noqa: ARG001
    async with (
        RosMaster() as master,
        RosEnvironment(tmp_path, master_uri=master.uri) as ros,
        Node("/ours", master_uri=master.uri) as node,
        node.advertise("/classes", "std_msgs/String"),
    ):
        await until(lambda: node.registered, "the node is registered")
        info = await (await ros.rostopic("info", "/classes")).finished()
        assert f"/ours ({node.uri})" in info
        kind = await (await ros.rostopic("type", "/classes")).finished()
        assert kind.strip() == "std_msgs/String"


async def test_rospy_node_whose_name_is_taken_ends(ros_installed: None, tmp_path: Path) -> None:  # noqa: ARG001
    async with RosMaster() as master, RosEnvironment(tmp_path, master_uri=master.uri) as ros:
        first = await ros.script(TALKER, "talker", "/chatter", "20")
        await first.until_output("talker up")
        await ros.script(TALKER, "talker", "/chatter", "20")
        assert "new node registered with same name" in await first.finished()
