"""Publishes one message of every sensor type with rospy, again and again; run under the system's Python.

Everything is stamped 1700000000.5 in frame "sensor"; the test that starts this knows the rest.
Arguments: a JPEG file and a PNG file of 16-bit grey, in hexadecimal.
"""

import struct
import sys

import rospy
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from sensor_msgs.msg import BatteryState, CameraInfo, CompressedImage, Image, PointCloud2, PointField
from std_msgs.msg import Header, String
from stereo_msgs.msg import DisparityImage
from tf2_msgs.msg import TFMessage

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


def compressed(said: str, file: str) -> CompressedImage:
    """Return a file as a compressed image."""
    return CompressedImage(header=STAMP, format=said, data=bytes.fromhex(file))


def disparity() -> DisparityImage:
    """Return two disparities of a stereo camera of 500 pixels and 0.1 m, the second of them unknown."""
    pixels = struct.pack("<2f", 25, -1)
    return DisparityImage(
        header=STAMP, image=Image(height=1, width=2, encoding="32FC1", step=8, data=pixels), f=500, T=0.1
    )


def transform(child: str) -> TFMessage:
    """Return where one frame is in the sensor's."""
    moved = Transform(Vector3(1, 2, 3), Quaternion(0, 0, 0.6, 0.8))
    return TFMessage([TransformStamped(header=STAMP, child_frame_id=child, transform=moved)])


jpeg, png = sys.argv[1:]
SENT = {
    "/front/color/image_raw/compressed": compressed("bgr8; jpeg compressed bgr8", jpeg),
    "/rear/depth/image_raw/compressedDepth": compressed("16UC1; compressedDepth", "00" * 12 + png),
    "/stereo/disparity": disparity(),
    "/front/depth/image_raw": depth(),
    "/front/color/camera_info": info(),
    "/front/depth/points": points(),
    "/tf": transform("moving"),
    "/mode": String("ready for Kisten und Kästen"),
    "/battery": BatteryState(header=STAMP, percentage=0.5, location="left"),
}

rospy.init_node("sensors")
publishers = {topic: rospy.Publisher(topic, type(message), queue_size=2) for topic, message in SENT.items()}
latched = rospy.Publisher("/tf_static", TFMessage, queue_size=2, latch=True)
latched.publish(transform("fixed"))
sys.stdout.write("sensors up\n")
sys.stdout.flush()
ticks = rospy.Rate(10)
while not rospy.is_shutdown():
    for topic, message in SENT.items():
        publishers[topic].publish(message)
    ticks.sleep()
