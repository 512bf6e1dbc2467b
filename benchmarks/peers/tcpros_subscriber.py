"""Receives a ROS 1 topic of the camera into one buffer and does nothing with it. Argument: topic.

Says what the Zenoh subscriber says: no gateway can have more frames.
"""

import os
import socket
import struct
import sys
import threading
import time
from contextlib import suppress
from typing import Any, Final
from xmlrpc.client import ServerProxy

from benchmarks.peers.answering import answer
from benchmarks.peers.camera import IMAGE, MD5SUM, NAME, TYPE, header, receive_header
from benchmarks.peers.frames import SIZE
from benchmarks.peers.zenoh_subscriber import Account

CALLER: Final = "/bench_subscriber"


def connect(topic: str) -> socket.socket:
    """Return the connection, once there is a camera; an earlier one's address may still be known."""
    master: Any = ServerProxy(os.environ["ROS_MASTER_URI"])
    while True:
        with suppress(OSError):
            _, _, uri = master.lookupNode(CALLER, NAME)
            camera: Any = ServerProxy(uri)
            _, _, (_, host, port) = camera.requestTopic(CALLER, topic, [["TCPROS"]])
            break
        time.sleep(0.05)
    connection = socket.create_connection((host, port))
    connection.sendall(header({"callerid": CALLER, "topic": topic, "type": TYPE, "md5sum": MD5SUM}))
    receive_header(connection)
    return connection


def receive(topic: str, account: Account) -> None:
    """Receive until the camera leaves."""
    connection = connect(topic)
    frame = bytearray(struct.calcsize("<I") + len(IMAGE) + SIZE)
    while connection.recv_into(frame, 0, socket.MSG_WAITALL):
        account.take(frame)


if __name__ == "__main__":
    received = Account()
    threading.Thread(target=receive, args=(sys.argv[1], received), daemon=True).start()
    answer(received.told)
