"""Simulated robots at Debian's real master, as any ROS node sees them."""

import hashlib
import logging

from services.toolbox.demo.children import child
from tests.integration.ros import RosEnvironment
from tests.integration.rospy_scripts import IMAGE_LISTENER

log = logging.getLogger(__name__)


async def test_robots_share_a_real_master_each_under_its_own_name(ros: RosEnvironment) -> None:
    options = ["simulate", "--robots", "2", "--hz", "10", "--width", "64", "--height", "48", "--frames", "1"]
    async with child("simulator", [*options, "--ros-master", ros.master_uri], log.info):
        listener = await ros.script(IMAGE_LISTENER, "/r2/camera/color/image_raw")
        await listener.until_output("image 64 48 rgb8 camera_color_optical_frame")
        await listener.until_output("\nimage")
        listed = await (await ros.rostopic("list")).finished()
        assert {"/r1/camera/color/image_raw", "/r2/camera/color/image_raw"} <= set(listed.split())
        kind = await (await ros.rostopic("type", "/r1/camera/color/image_raw")).finished()
        assert kind.strip() == "sensor_msgs/Image"
        shown = [line.split()[-1] for line in listener.output.splitlines() if line.startswith("image")]
        assert set(shown) != {hashlib.sha256(b"").hexdigest()}
        await listener.end()
    gone = await (await ros.rostopic("list")).finished()
    assert "/r1/camera/color/image_raw" not in gone
