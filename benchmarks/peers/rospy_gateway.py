"""What one would write first: every image of a rospy subscriber put on Zenoh. Arguments: Zenoh config, key."""

import sys

import rospy
import zenoh
from sensor_msgs.msg import Image

session = zenoh.open(zenoh.Config.from_json5(sys.argv[1]))
publisher = session.declare_publisher(
    sys.argv[2],
    congestion_control=zenoh.CongestionControl.DROP,
    priority=zenoh.Priority.DATA_LOW,
    reliability=zenoh.Reliability.BEST_EFFORT,
)
rospy.init_node("gateway", anonymous=True, disable_signals=True)


def forward(image: Image) -> None:
    """Put the pixels on Zenoh."""
    publisher.put(image.data)


rospy.Subscriber("/camera/color/image_raw", Image, forward, queue_size=1, buff_size=2**24)
rospy.spin()
