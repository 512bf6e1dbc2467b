"""Publishes colour and depth of one camera with rospy, 30 frames a second; run under the system's Python.

Depth is stamped two milliseconds after colour and misses every seventh frame. Every depth value is the frame's number.
"""

import struct
import sys

import rospy
from sensor_msgs.msg import Image

rospy.init_node("camera")
color = rospy.Publisher("/front/color/image_raw", Image, queue_size=2)
depth = rospy.Publisher("/front/depth/image_raw", Image, queue_size=2)
ticks = rospy.Rate(30)
number = 0
sys.stdout.write("camera up\n")
sys.stdout.flush()
while not rospy.is_shutdown():
    stamp = rospy.Time.now()
    picture = Image(height=240, width=320, encoding="bgr8", step=960, data=bytes(240 * 960))
    picture.header.stamp = stamp
    color.publish(picture)
    distances = Image(height=240, width=320, encoding="16UC1", step=640, data=struct.pack("<H", number) * 240 * 320)
    distances.header.stamp = stamp + rospy.Duration(0, 2_000_000)
    if number % 7:
        depth.publish(distances)
    number += 1
    ticks.sleep()
