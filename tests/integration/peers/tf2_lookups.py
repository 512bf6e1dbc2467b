"""Asks tf2's own buffer where frames are; run under the system's Python.

The argument is a JSON object. said: transforms in the order in which they arrive, each as [static, parent, child,
translation, rotation, stamp in ns]. asked: lookups after all of them, each as [target, source, stamp in ns]. It prints
a list of a translation and a rotation for each lookup, or of null where tf2 knows none.
"""

import json
import sys

import rospy
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from std_msgs.msg import Header
from tf2_py import BufferCore, TransformException


def stamp(nanoseconds: int) -> rospy.Time:
    """Return a time of so many nanoseconds."""
    return rospy.Time(*divmod(nanoseconds, 1_000_000_000))


task = json.loads(sys.argv[1])
buffer = BufferCore(rospy.Duration(10))
for static, parent, child, at, turned, stamp_ns in task["said"]:
    header = Header(stamp=stamp(stamp_ns), frame_id=parent)
    said = TransformStamped(header, child, Transform(Vector3(*at), Quaternion(*turned)))
    (buffer.set_transform_static if static else buffer.set_transform)(said, "test")
found: list[list[list[float]] | None] = []
for target, source, stamp_ns in task["asked"]:
    try:
        known = buffer.lookup_transform_core(target, source, stamp(stamp_ns)).transform
    except TransformException:
        found.append(None)
    else:
        at, turned = known.translation, known.rotation
        found.append([[at.x, at.y, at.z], [turned.x, turned.y, turned.z, turned.w]])
sys.stdout.write(json.dumps(found))
