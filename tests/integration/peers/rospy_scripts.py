"""What the rospy side of the tests does; run under the system's Python, so these are texts."""

from __future__ import annotations

TALKER = """
import sys, rospy
from std_msgs.msg import String
name, topic, rate = sys.argv[1], sys.argv[2], float(sys.argv[3])
rospy.init_node(name)
publisher = rospy.Publisher(topic, String, queue_size=10, latch=len(sys.argv) > 4)
print("talker up", flush=True)
count, ticks = 0, rospy.Rate(rate)
while not rospy.is_shutdown():
    publisher.publish("%s %d" % (name, count))
    count += 1
    try:
        ticks.sleep()
    except rospy.ROSInterruptException:
        break
"""

LISTENER = """
import sys, rospy
from std_msgs.msg import String
rospy.init_node(sys.argv[1])
rospy.Subscriber(sys.argv[2], String, lambda message: print("heard " + message.data, flush=True))
print("listener up", flush=True)
rospy.spin()
"""

CAMERA = """
import sys, rospy
from sensor_msgs.msg import Image
rospy.init_node("camera")
publisher = rospy.Publisher(sys.argv[1], Image, queue_size=2)
image = Image()
image.header.frame_id = "front"
image.header.stamp = rospy.Time(1700000000, 123456789)
image.height, image.width, image.encoding, image.step = 480, 640, "rgb8", 1920
image.data = bytes(i % 251 for i in range(480 * 1920))
print("camera up", flush=True)
rate = float(sys.argv[2])
while publisher.get_num_connections() == 0 and not rospy.is_shutdown():
    rospy.sleep(0.01)
while not rospy.is_shutdown():
    publisher.publish(image)
    if rate:
        rospy.sleep(1 / rate)
"""

BAG_READER = """
import sys, rosbag
with rosbag.Bag(sys.argv[1]) as bag:
    for topic, message, stamp, header in bag.read_messages(return_connection_header=True):
        fields = (header[name].decode() for name in ("type", "md5sum", "callerid", "message_definition"))
        print("read", topic, message.data, *fields, flush=True)
"""

BAG_TOPICS = """
import sys, rosbag
with rosbag.Bag(sys.argv[1]) as bag:
    print(*{topic for topic, message, stamp in bag.read_messages()}, flush=True)
"""

BAG_SUMMARY = """
import sys, json, rosbag
with rosbag.Bag(sys.argv[1]) as bag:
    for topic, message, stamp, header in bag.read_messages(return_connection_header=True):
        found = {name: header[name].decode() for name in ("type", "md5sum", "message_definition")}
        print(json.dumps([topic, found, type(message)._full_text, len(message.data)]), flush=True)
"""

IMAGE_LISTENER = """
import sys, hashlib, rospy
from sensor_msgs.msg import Image
rospy.init_node("image_listener")
def show(m):
    print("image", m.width, m.height, m.encoding, m.header.frame_id, m.header.stamp.to_nsec(),
          hashlib.sha256(m.data).hexdigest(), flush=True)
rospy.Subscriber(sys.argv[1], Image, show)
print("listener up", flush=True)
rospy.spin()
"""

STATIC_FRAME = """
import sys, rospy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage
rospy.init_node(sys.argv[1])
publisher = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
only = TransformStamped(child_frame_id=sys.argv[1])
only.header.frame_id, only.transform.rotation.w = "base_link", 1.0
publisher.publish(TFMessage([only]))
print("latched", flush=True)
rospy.spin()
"""

STATIC_FRAMES = """
import sys, rospy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage
rospy.init_node("nodelets")
broadcasters = [(rospy.Publisher("/tf_static", TFMessage, queue_size=9, latch=True), child) for child in sys.argv[1:]]
while not broadcasters[0][0].get_num_connections():
    rospy.sleep(0.01)
for publisher, child in broadcasters:
    only = TransformStamped(child_frame_id=child)
    only.header.frame_id, only.transform.rotation.w = "base_link", 1.0
    publisher.publish(TFMessage([only]))
print("latched", flush=True)
rospy.spin()
"""

PICTURE = """
import sys, rospy
from sensor_msgs.msg import Image
name, topic, grey = sys.argv[1], sys.argv[2], int(sys.argv[3])
rospy.init_node(name)
publisher = rospy.Publisher(topic, Image, queue_size=1, latch=True)
publisher.publish(Image(height=1000, width=1000, encoding="mono8", step=1000, data=bytes([grey]) * 1000000))
print("latched", flush=True)
rospy.spin()
"""

GREY_CAMERA = """
import sys, rospy
from sensor_msgs.msg import CompressedImage, Image
name, topic, grey, *kind = sys.argv[1:]
rospy.init_node(name)
data = bytes([int(grey)]) * 48
if kind:
    import base64
    data = base64.b64decode(kind[0])
    message = CompressedImage(format="jpeg", data=data)
else:
    message = Image(height=6, width=8, encoding="mono8", step=8, data=data)
publisher = rospy.Publisher(topic, type(message), queue_size=2)
print("camera up", flush=True)
ticks = rospy.Rate(20)
while not rospy.is_shutdown():
    message.header.stamp = rospy.Time.now()
    publisher.publish(message)
    try:
        ticks.sleep()
    except rospy.ROSInterruptException:
        break
"""

ECHOED_CAMERA = """
import sys, threading, rospy
from sensor_msgs.msg import Image
name, topic, echo = sys.argv[1:]
rospy.init_node(name)
message = Image(height=6, width=8, encoding="mono8", step=8, data=bytes(48))
echoed = threading.Event()
subscriber = rospy.Subscriber(echo, Image, lambda _: echoed.set())
publisher = rospy.Publisher(topic, Image, queue_size=10)
print("camera up", flush=True)
while not rospy.is_shutdown():
    echoed.clear()
    for _ in range(2):
        message.header.stamp = rospy.Time.now()
        publisher.publish(message)
    echoed.wait(1)
    rospy.sleep(0.05)
"""
"""Publishes two at a time, the next when one came back: no queue on the way overflows, however busy the machine."""

BURSTS = """
import sys, rospy
from rospy.impl import rosout
from std_msgs.msg import String
topic, rounds, latch = sys.argv[1], int(sys.argv[2]), sys.argv[3] == "latch"
rospy.init_node("bursts")
logs = topic == "/rosout"
publisher = rosout._rosout_pub if logs else rospy.Publisher(topic, String, queue_size=100, latch=latch)
while not publisher.get_num_connections() and not rospy.is_shutdown():
    rospy.sleep(0.01)
for start in range(0, 10 * rounds, 10):
    rospy.sleep(0.5)
    for number in range(start, start + 10):
        rospy.loginfo("line %d", number) if logs else publisher.publish(str(number))
rospy.spin()
"""

LARGE_CAMERA = """
import sys, rospy
from sensor_msgs.msg import Image
topic, width, height = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
rospy.init_node("camera")
message = Image(height=height, width=width, encoding="rgb8", step=3 * width, data=b"abc" * (width * height))
publisher = rospy.Publisher(topic, Image, queue_size=1)
print("camera up", flush=True)
while not rospy.is_shutdown():
    message.header.stamp = rospy.Time.now()
    publisher.publish(message)
    rospy.sleep(0.7)
"""

OAK = """
import rospy
from sensor_msgs.msg import CameraInfo, Image
rospy.init_node("oak")
images = {
    "rgb": Image(height=4, width=6, encoding="rgb8", step=18, data=bytes(72)),
    "stereo": Image(height=4, width=6, encoding="16UC1", step=12, data=bytes([1, 2]) * 24),
}
info = CameraInfo(height=4, width=6, distortion_model="plumb_bob", D=[0] * 5, K=[6, 0, 3, 0, 6, 2, 0, 0, 1])
info.P = [6, 0, 3, 0, 0, 6, 2, 0, 0, 0, 1, 0]
publishers = [
    (rospy.Publisher("/oak/%s/%s" % (name, leaf), type(message), queue_size=2), message)
    for name, image in images.items()
    for leaf, message in (("image_raw", image), ("camera_info", info))
]
print("camera up", flush=True)
ticks = rospy.Rate(10)
while not rospy.is_shutdown():
    now = rospy.Time.now()
    for publisher, message in publishers:
        message.header.stamp, message.header.frame_id = now, "lens"
        publisher.publish(message)
    try:
        ticks.sleep()
    except rospy.ROSInterruptException:
        break
"""

OFF_CAMERA = """
import sys, rospy
from sensor_msgs.msg import Image
name, topic, behind_s = sys.argv[1], sys.argv[2], float(sys.argv[3])
rospy.init_node(name)
message = Image(height=6, width=8, encoding="mono8", step=8, data=bytes(48))
publisher = rospy.Publisher(topic, Image, queue_size=2)
print("camera up", flush=True)
ticks = rospy.Rate(30)
while not rospy.is_shutdown():
    message.header.stamp = rospy.Time.now() - rospy.Duration(behind_s)
    publisher.publish(message)
    try:
        ticks.sleep()
    except rospy.ROSInterruptException:
        break
"""

SENSORS = """
import base64, sys, rospy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2
kinds = {kind.__name__: kind for kind in (CameraInfo, CompressedImage, Image, PointCloud2)}
jpeg = base64.b64decode(sys.argv[2])
topics = dict(argument.split("=") for argument in sys.argv[3:])
rospy.init_node(sys.argv[1])
publishers = [rospy.Publisher(topic, kinds[kind], queue_size=2) for topic, kind in topics.items()]
def message(kind, stamp):
    if kind is Image:
        made = Image(height=1, width=2, encoding="rgb8", step=6, data=bytes(6))
    elif kind is CompressedImage:
        made = CompressedImage(format="jpeg", data=jpeg)
    else:
        made = kind(height=1, width=2)
    made.header.stamp = stamp
    return made
print("sensors up", flush=True)
ticks = rospy.Rate(10)
while not rospy.is_shutdown():
    stamp = rospy.Time.now()
    for publisher in publishers:
        publisher.publish(message(publisher.data_class, stamp))
    try:
        ticks.sleep()
    except rospy.ROSInterruptException:
        break
"""

INSTANTS = """
import json, sys, rospy, tf2_ros
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
kinds = {kind.__name__: kind for kind in (CameraInfo, Image, PointCloud2)}
topics = dict(argument.split("=") for argument in sys.argv[2:])
rospy.init_node("instants")
buffer = tf2_ros.Buffer()
listener = tf2_ros.TransformListener(buffer)
instants = {}
def show(stamp, messages):
    frames = {message.header.frame_id for message in messages.values()}
    rospy.sleep(0.1)
    found = {}
    for frame in frames:
        at = buffer.lookup_transform("map", frame, stamp).transform
        t, r = at.translation, at.rotation
        found[frame] = [t.x, t.y, t.z, r.x, r.y, r.z, r.w]
    heads = {topic: [m.header.seq, m.header.frame_id, m.height, m.width] for topic, m in messages.items()}
    print("instant " + json.dumps([heads, found, stamp.to_nsec()]), flush=True)
def receive(message, topic):
    messages = instants.setdefault(message.header.stamp.to_nsec(), {})
    messages[topic] = message
    if len(messages) == len(topics):
        whole.append((message.header.stamp, messages))
whole = []
for topic, kind in topics.items():
    rospy.Subscriber(topic, kinds[kind], receive, topic)
while not rospy.is_shutdown() and len(whole) < int(sys.argv[1]):
    rospy.sleep(0.05)
for stamp, messages in whole:
    show(stamp, messages)
"""
