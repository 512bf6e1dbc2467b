"""Publishes raw pixels from files with rospy; run under the system's Python. Arguments: topic, rate in Hz, then images.

An image is PATH:WIDTH:HEIGHT:ENCODING; they are published in turn. Bytes are sent as they are, fitting or not.
"""

import itertools
import sys
from pathlib import Path

import rospy
from sensor_msgs.msg import Image

topic, rate, *files = sys.argv[1:]
rospy.init_node("camera", anonymous=True)
publisher = rospy.Publisher(topic, Image, queue_size=2)


def load(text: str) -> Image:
    """Return the message of one image argument."""
    path, width, height, encoding = text.rsplit(":", 3)
    image = Image(width=int(width), height=int(height), encoding=encoding, data=Path(path).read_bytes())
    image.step = image.width * {"mono8": 1, "rgba8": 4, "bgra8": 4}.get(encoding, 3)
    image.header.frame_id = "camera_color_optical_frame"
    return image


sys.stdout.write("camera up\n")
sys.stdout.flush()
ticks = rospy.Rate(float(rate))
for image in itertools.cycle([load(text) for text in files]):
    if rospy.is_shutdown():
        break
    image.header.stamp = rospy.Time.now()
    publisher.publish(image)
    ticks.sleep()
