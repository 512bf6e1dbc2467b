"""Says what Debian's sensor_msgs.point_cloud2 reads in clouds; run under the system's Python.

Reads lines of a sensor_msgs/PointCloud2 in hexadecimal. Prints for each the list of its points as JSON.
"""

import json
import sys

from sensor_msgs.msg import PointCloud2
from sensor_msgs.point_cloud2 import read_points

for line in sys.stdin:
    cloud = PointCloud2().deserialize(bytes.fromhex(line))
    sys.stdout.write(json.dumps(list(read_points(cloud))) + "\n")
