"""Publishes colour, depth, both calibrations and transforms of one camera with rospy; run under the system's Python.

A wall 4 m away and, in the middle of the picture, a box 2.31 m away, in millimetres. 10 frames a second.
"""

import array
import sys

import rospy
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

WIDTH, HEIGHT = 320, 240
FRAME = "camera_color_optical_frame"


def calibration(header: Header) -> CameraInfo:
    """Return a calibration without distortion."""
    k = [240, 0, 159.5, 0, 240, 119.5, 0, 0, 1]
    return CameraInfo(header=header, height=HEIGHT, width=WIDTH, distortion_model="plumb_bob", D=[0] * 5, K=k)


def scene() -> bytes:
    """Return the depth image's bytes."""
    rows = [[4000] * WIDTH for _ in range(HEIGHT)]
    for row in rows[80:160]:
        row[120:200] = [2310] * 80
    return array.array("H", [each for row in rows for each in row]).tobytes()


def moved(parent: str, child: str, stamp: rospy.Time) -> TFMessage:
    """Return that one frame is a metre along another's x axis."""
    transform = Transform(Vector3(1, 0, 0), Quaternion(0, 0, 0, 1))
    header = Header(stamp=stamp, frame_id=parent)
    return TFMessage([TransformStamped(header=header, child_frame_id=child, transform=transform)])


rospy.init_node("depth_camera")
color = rospy.Publisher("/front/color/image_raw", Image, queue_size=2)
depth = rospy.Publisher("/front/depth/image_raw", Image, queue_size=2)
infos = [rospy.Publisher(f"/front/{kind}/camera_info", CameraInfo, queue_size=2) for kind in ("color", "depth")]
tf = rospy.Publisher("/tf", TFMessage, queue_size=9)
static = rospy.Publisher("/tf_static", TFMessage, queue_size=2, latch=True)
static.publish(moved("base_link", FRAME, rospy.Time(0)))
pixels = scene()
sys.stdout.write("scene up\n")
sys.stdout.flush()
ticks = rospy.Rate(10)
while not rospy.is_shutdown():
    head = Header(stamp=rospy.Time.now(), frame_id=FRAME)
    tf.publish(moved("map", "base_link", head.stamp))
    color.publish(Image(header=head, height=HEIGHT, width=WIDTH, encoding="rgb8", step=960, data=bytes(HEIGHT * 960)))
    depth.publish(Image(header=head, height=HEIGHT, width=WIDTH, encoding="16UC1", step=640, data=pixels))
    for info in infos:
        info.publish(calibration(head))
    ticks.sleep()
