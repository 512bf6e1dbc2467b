"""The least that a gateway can do: a plain socket receives a ROS 1 topic, each message is put on Zenoh as it is.

Arguments: Zenoh config, key, topic. One buffer takes every message; nothing is read, checked, counted or dropped.
"""

import socket
import struct
import sys

import zenoh

from benchmarks.peers.camera import IMAGE
from benchmarks.peers.frames import SIZE
from benchmarks.peers.tcpros_subscriber import connect

with zenoh.open(zenoh.Config.from_json5(sys.argv[1])) as session:
    publisher = session.declare_publisher(
        sys.argv[2],
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.DATA_LOW,
        reliability=zenoh.Reliability.BEST_EFFORT,
    )
    connection = connect(sys.argv[3])
    frame = bytearray(struct.calcsize("<I") + len(IMAGE) + SIZE)
    while connection.recv_into(frame, 0, socket.MSG_WAITALL):
        publisher.put(frame)
