"""Publishes what the doctor is to look at, with rospy; run under the system's Python.

Arguments: the node's name, then what it publishes, each as TOPIC=KIND. Kinds are the functions below.
"""

import struct
import sys
from collections.abc import Callable

import rospy
from geometry_msgs.msg import Quaternion, Transform, TransformStamped
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header, String
from tf2_msgs.msg import TFMessage

COLOR, DEPTH = "color_lens", "depth_lens"


def color() -> Image:
    """Return a colour image of 64x48 pixels."""
    header = Header(stamp=rospy.Time.now(), frame_id=COLOR)
    return Image(header=header, height=48, width=64, encoding="rgb8", step=192, data=bytes(48 * 192))


def rear() -> Image:
    """Return such an image of another camera."""
    return Image(header=Header(frame_id="rear_lens"), height=48, width=64, encoding="rgb8", step=192, data=bytes(9216))


def doubled() -> CameraInfo:
    """Return the calibration of twice colour's resolution, with colour's size."""
    lens = [120, 0, 64, 0, 120, 48, 0, 0, 1]
    header = Header(stamp=rospy.Time.now(), frame_id=COLOR)
    return CameraInfo(header=header, height=48, width=64, distortion_model="plumb_bob", D=[0] * 5, K=lens)


def base() -> TFMessage:
    """Return where a lidar is on the robot, and nothing of the cameras."""
    moved = Transform(rotation=Quaternion(w=1))
    return TFMessage([TransformStamped(Header(frame_id="base_link"), "lidar", moved)])


def unknown() -> Image:
    """Return an image in an encoding that nobody knows."""
    return Image(height=4, width=6, encoding="rgb9", step=18, data=bytes(72))


def depth() -> Image:
    """Return a depth image of half the size."""
    header = Header(stamp=rospy.Time.now(), frame_id=DEPTH)
    return Image(header=header, height=24, width=32, encoding="16UC1", step=64, data=struct.pack("<H", 2310) * 768)


def info() -> CameraInfo:
    """Return colour's calibration."""
    header = Header(stamp=rospy.Time.now(), frame_id=COLOR)
    lens = [60, 0, 32, 0, 60, 24, 0, 0, 1]
    return CameraInfo(header=header, height=48, width=64, distortion_model="plumb_bob", D=[0] * 5, K=lens)


def static() -> TFMessage:
    """Return where depth's lens is, seen from colour's."""
    moved = Transform(rotation=Quaternion(w=1))
    return TFMessage([TransformStamped(header=Header(frame_id=COLOR), child_frame_id=DEPTH, transform=moved)])


def text() -> String:
    """Return a text."""
    return String("hello")


def silent() -> None:
    """Publish images never."""


KINDS: dict[str, tuple[Callable[[], object], type]] = {
    "color": (color, Image),
    "unknown": (unknown, Image),
    "depth": (depth, Image),
    "info": (info, CameraInfo),
    "static": (static, TFMessage),
    "rear": (rear, Image),
    "doubled": (doubled, CameraInfo),
    "base": (base, TFMessage),
    "text": (text, String),
    "silent": (silent, Image),
}

name, *topics = sys.argv[1:]
rospy.init_node(name)
pairs = [topic.split("=") for topic in topics]
publishers = [
    (rospy.Publisher(topic, KINDS[kind][1], queue_size=2, latch=kind in {"static", "base"}), KINDS[kind][0])
    for topic, kind in pairs
]
sys.stdout.write("publishers up\n")
sys.stdout.flush()
ticks = rospy.Rate(20)
said: set[rospy.Publisher] = set()
while not rospy.is_shutdown():
    for publisher, make in publishers:
        message = make()
        if message is not None and not (publisher.impl.is_latch and publisher in said):
            publisher.publish(message)
            said.add(publisher)
    try:
        ticks.sleep()
    except rospy.ROSInterruptException:
        break
