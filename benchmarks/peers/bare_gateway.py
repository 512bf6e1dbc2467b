"""The least that a gateway can do: a plain socket receives a ROS 1 topic, each message is put on Zenoh as it is.

Arguments: Zenoh config, key, topic. One buffer takes every message; nothing is read, checked, counted or dropped.
"""

import socket
import struct
import sys

from benchmarks.peers.camera import IMAGE
from benchmarks.peers.frames import SIZE
from benchmarks.peers.tcpros_subscriber import connect
from benchmarks.peers.zenoh_sender import sender

with sender(sys.argv[1], sys.argv[2]) as publisher:
    connection = connect(sys.argv[3])
    frame = bytearray(struct.calcsize("<I") + len(IMAGE) + SIZE)
    while connection.recv_into(frame, 0, socket.MSG_WAITALL):
        publisher.put(frame)
