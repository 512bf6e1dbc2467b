"""Publishes an organised, coloured point cloud with rospy, ten times a second; run under the system's Python.

A red box of 20 x 20 points is 2 m away before a grey wall at 4 m; the camera looks level from 1 m above base_link.
"""

import struct
import sys

import rospy
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

HEIGHT, WIDTH, FOCAL = 40, 60, 50.0
ROWS, COLUMNS = range(10, 30), range(20, 40)
RED, GREY = 0xFF0000, 0x808080
FIELDS = [PointField(name, 4 * at, PointField.FLOAT32, 1) for at, name in enumerate(("x", "y", "z"))]
FIELDS.append(PointField("rgb", 16, PointField.FLOAT32, 1))


def point(row: int, column: int) -> bytes:
    """Return a point as its driver lays it out: four bytes of nothing before the colour."""
    is_box = row in ROWS and column in COLUMNS
    z = 2.0 if is_box else 4.0
    x, y = (column - (WIDTH - 1) / 2) / FOCAL * z, (row - (HEIGHT - 1) / 2) / FOCAL * z
    return struct.pack("<4fI", x, y, z, 0.0, RED if is_box else GREY)


POINTS = b"".join(point(row, column) for row in range(HEIGHT) for column in range(WIDTH))

rospy.init_node("cloud_camera", anonymous=True)
clouds = rospy.Publisher("/front/depth_registered/points", PointCloud2, queue_size=1)
static = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
place = Transform(Vector3(0, 0, 1), Quaternion(-0.5, 0.5, -0.5, 0.5))
static.publish(TFMessage([TransformStamped(Header(frame_id="base_link"), "front_optical_frame", place)]))
sys.stdout.write("publishers up\n")
sys.stdout.flush()
rate = rospy.Rate(10)
while not rospy.is_shutdown():
    stamped = Header(stamp=rospy.Time.now(), frame_id="front_optical_frame")
    clouds.publish(
        PointCloud2(
            header=stamped,
            height=HEIGHT,
            width=WIDTH,
            fields=FIELDS,
            point_step=20,
            row_step=20 * WIDTH,
            data=POINTS,
            is_dense=False,
        )
    )
    rate.sleep()
