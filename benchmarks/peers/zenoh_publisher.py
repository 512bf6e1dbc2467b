"""Puts frames on Zenoh: no ROS, no gateway. Arguments: Zenoh config, key, Hz (0: flat out)."""

import sys

import zenoh

from benchmarks.peers.frames import frames

with zenoh.open(zenoh.Config.from_json5(sys.argv[1])) as session:
    publisher = session.declare_publisher(
        sys.argv[2],
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.DATA_LOW,
        reliability=zenoh.Reliability.BEST_EFFORT,
    )
    for frame in frames(hz=float(sys.argv[3])):
        publisher.put(frame)
