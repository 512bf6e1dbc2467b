"""Publishes an image of every encoding with rospy, again and again; run under the system's Python.

Arguments: TOPIC=ENCODING:WIDTH:STEP:BIGENDIAN:DATA of images that are two rows high, data in hexadecimal.
"""

import sys

import rospy
from sensor_msgs.msg import Image


def image(said: str) -> Image:
    """Return the message of one argument."""
    encoding, width, step, bigendian, data = said.split(":")
    return Image(
        height=2,
        width=int(width),
        step=int(step),
        encoding=encoding,
        is_bigendian=int(bigendian),
        data=bytes.fromhex(data),
    )


images = {topic: image(said) for topic, said in (argument.split("=", 1) for argument in sys.argv[1:])}
rospy.init_node("encodings")
publishers = {topic: rospy.Publisher(topic, Image, queue_size=2) for topic in images}
sys.stdout.write("encodings up\n")
sys.stdout.flush()
ticks = rospy.Rate(20)
while not rospy.is_shutdown():
    for topic, publisher in publishers.items():
        publisher.publish(images[topic])
    ticks.sleep()
