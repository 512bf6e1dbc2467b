"""Puts one 640x480 rgb8 image on Zenoh flat out: no ROS, no gateway. Arguments: Zenoh config, key."""

import sys

import zenoh

image = bytes(range(256)) * 3600
with zenoh.open(zenoh.Config.from_json5(sys.argv[1])) as session:
    publisher = session.declare_publisher(
        sys.argv[2],
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.DATA_LOW,
        reliability=zenoh.Reliability.BEST_EFFORT,
    )
    while True:
        publisher.put(image)
