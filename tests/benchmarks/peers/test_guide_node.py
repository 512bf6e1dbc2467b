"""The guide's nodes, in our words, on Debian's real ROS 1."""

import ast
import re
from contextlib import AsyncExitStack
from functools import partial

from benchmarks.gateway.processes import module, ros_master, running
from benchmarks.guide.outputs import GUIDE
from benchmarks.guide.robot import robot
from benchmarks.guide.scene import Scene
from benchmarks.guide.sides import NODES, Side
from benchmarks.guide.topics import CLASSES, DETECTION, DISTANCE, OBJECTS_SHOWN, SEGMENTATION
from gateway.ros1.image import decode_image
from gateway.ros1.messages import deserialise
from gateway.ros1.node import Node
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_ros.outputs import STRING
from services.detector.settings import SHIPPED_MODEL
from tests.integration.peers.ros import require_ros


async def heard() -> dict[str, bytes]:
    """Run the nodes until each output has come; return the last message of each."""
    last: dict[str, bytes] = {}

    def take(topic: str, message: Message) -> None:
        last[topic] = bytes(message.data)

    async with AsyncExitStack() as stack:
        master = stack.enter_context(ros_master())
        nodes = stack.enter_context(running(module("with_ros", "guide_node", str(SHIPPED_MODEL), *NODES), master))
        node = await stack.enter_async_context(Node("/test", master_uri=master))
        for topic, kind in GUIDE.items():
            await stack.enter_async_context(node.subscribe(topic, kind, partial(take, topic)))
        made = await stack.enter_async_context(robot(master, Scene(1), GUIDE))
        while len(last) < len(GUIDE):
            await Side(made, {"guide": nodes}).ready()
    return last


async def test_every_output_of_the_guide_comes() -> None:
    require_ros()
    last = await heard()
    texts = {topic: deserialise(STRING, last[topic]).data for topic in (CLASSES, DISTANCE, OBJECTS_SHOWN)}
    names = ast.literal_eval(texts[CLASSES])
    assert names
    assert set(names) <= {"box", "pallet", "forklift"}
    assert [each.partition(":")[0] for each in ast.literal_eval(texts[DISTANCE])] == names
    assert all(re.fullmatch(r"\w+: \d+\.\d\d", each) for each in ast.literal_eval(texts[DISTANCE]))
    assert int(texts[OBJECTS_SHOWN]) > 0
    drawn = {topic: decode_image(last[topic]) for topic in (DETECTION, SEGMENTATION)}
    assert {(each.height, each.width, each.encoding, each.stamp) for each in drawn.values()} == {(480, 640, "bgr8", 0)}
    assert bytes(drawn[DETECTION].data) != bytes(drawn[SEGMENTATION].data)
