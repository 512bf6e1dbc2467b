"""Puts frames on Zenoh: no ROS, no gateway. Arguments: Zenoh config, key, Hz (0: flat out)."""

import sys

from benchmarks.peers.frames import frames
from benchmarks.peers.zenoh_sender import sender

with sender(sys.argv[1], sys.argv[2]) as publisher:
    for frame in frames(hz=float(sys.argv[3])):
        publisher.put(frame)
