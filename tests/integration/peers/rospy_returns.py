"""Subscribes to returned topics with rospy and prints what it hears; run under the system's Python.

Arguments: topics, each with the short name of its type, like /ultralytics/alerts=String.
One line of JSON a message; of an image the first and last pixel of its middle row.
"""

import json
import sys
from typing import Any

import rospy
from sensor_msgs import point_cloud2
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

TYPES = {"Image": Image, "MarkerArray": MarkerArray, "PointCloud2": PointCloud2, "String": String}


def show(message: Any, topic: str) -> None:
    """Print a message."""
    heard: dict[str, object] = {"topic": topic}
    if isinstance(message, String):
        heard["data"] = message.data
    elif isinstance(message, MarkerArray):
        heard["markers"] = [
            {
                "ns": each.ns,
                "id": each.id,
                "text": each.text,
                "frame_id": each.header.frame_id,
                "x": each.pose.position.x,
            }
            for each in message.markers
        ]
    else:
        stamp, frame_id = message.header.stamp.to_nsec(), message.header.frame_id
        heard.update(seq=message.header.seq, stamp=stamp, frame_id=frame_id, height=message.height, width=message.width)
    if isinstance(message, Image):
        row = message.data[message.height // 2 * message.step :][: message.step]
        heard.update(encoding=message.encoding, bytes=len(message.data), first=list(row[:3]), last=list(row[-3:]))
    if isinstance(message, PointCloud2):
        names = [each.name for each in message.fields if each.name != "rgb"]
        heard["points"] = [list(point) for point in point_cloud2.read_points(message, names)]
    sys.stdout.write(json.dumps(heard) + "\n")
    sys.stdout.flush()


rospy.init_node("returns_listener", anonymous=True)
for argument in sys.argv[1:]:
    topic, _, kind = argument.partition("=")
    rospy.Subscriber(topic, TYPES[kind], show, topic)
sys.stdout.write("listener up\n")
sys.stdout.flush()
rospy.spin()
