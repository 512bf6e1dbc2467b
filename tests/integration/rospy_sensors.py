"""Publishes one message of every sensor type with rospy, again and again; run under the system's Python.

Everything is stamped 1700000000.5 in frame "sensor"; the test that starts this knows the rest.
"""

import struct
import sys

import rospy
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import Header

STAMP = Header(stamp=rospy.Time(1700000000, 500000000), frame_id="sensor")


def depth() -> Image:
    """Return two millimetre readings, in network byte order."""
    return Image(
        header=STAMP, height=1, width=2, encoding="16UC1", is_bigendian=1, step=4, data=struct.pack(">2H", 0, 2310)
    )


def info() -> CameraInfo:
    """Return a calibration."""
    return CameraInfo(
        header=STAMP,
        height=480,
        width=640,
        distortion_model="plumb_bob",
        D=[0.5, -0.25, 0, 0, 0],
        K=[600, 0, 320, 0, 601, 240, 0, 0, 1],
        R=[1, 0, 0, 0, 1, 0, 0, 0, 1],
        P=[600, 0, 320, 0, 0, 601, 240, 0, 0, 0, 1, 0],
    )


def points() -> PointCloud2:
    """Return two points of x, y, z."""
    names = [PointField(name=name, offset=4 * n, datatype=PointField.FLOAT32, count=1) for n, name in enumerate("xyz")]
    data = struct.pack("<6f", 1, 2, 3, 4, 5, float("nan"))
    return PointCloud2(
        header=STAMP, height=1, width=2, fields=names, point_step=12, row_step=24, data=data, is_dense=False
    )


SENT = {
    "/front/depth/image_raw": depth(),
    "/front/color/camera_info": info(),
    "/front/depth/points": points(),
}

rospy.init_node("sensors")
publishers = {topic: rospy.Publisher(topic, type(message), queue_size=2) for topic, message in SENT.items()}
sys.stdout.write("sensors up\n")
sys.stdout.flush()
ticks = rospy.Rate(10)
while not rospy.is_shutdown():
    for topic, message in SENT.items():
        publishers[topic].publish(message)
    ticks.sleep()
