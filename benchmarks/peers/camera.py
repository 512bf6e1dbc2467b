"""A ROS 1 publisher on plain sockets, faster than any subscriber here. Arguments: Hz (0: flat out), topics.

Says how many messages it sent of each topic.
"""

import os
import socket
import struct
import sys
import threading
from collections import Counter
from functools import partial
from typing import Final
from xmlrpc.client import ServerProxy
from xmlrpc.server import SimpleXMLRPCServer

from benchmarks.peers.answering import answer
from benchmarks.peers.frames import HEIGHT, SIZE, STEP, WIDTH, frames

TYPE: Final = "sensor_msgs/Image"
MD5SUM: Final = "060021388200f6f0f447d0fcd9c64743"
NAME: Final = "/bench_camera"
HOST: Final = "127.0.0.1"
IMAGE: Final = struct.pack("<IIIIIII4sBII", 0, 1, 0, 0, HEIGHT, WIDTH, 4, b"rgb8", 0, STEP, SIZE)


def main() -> None:
    """Publish until the standard input ends."""
    hz, topics = float(sys.argv[1]), sys.argv[2:]
    listener = socket.create_server((HOST, 0))
    slave = SimpleXMLRPCServer((HOST, 0), logRequests=False)
    slave.register_function(lambda *_: [1, "", ["TCPROS", HOST, listener.getsockname()[1]]], "requestTopic")
    sent: Counter[str] = Counter()
    for serve in (slave.serve_forever, partial(accept, listener, hz, sent)):
        threading.Thread(target=serve, daemon=True).start()
    master = ServerProxy(os.environ["ROS_MASTER_URI"])
    uri = f"http://{HOST}:{slave.server_address[1]}"
    for topic in topics:
        master.registerPublisher(NAME, topic, TYPE, uri)
    answer(lambda: {topic: sent[topic] for topic in topics})


def accept(listener: socket.socket, hz: float, sent: Counter[str]) -> None:
    """Serve every subscriber on a thread of its own."""
    while True:
        connection, _ = listener.accept()
        threading.Thread(target=publish, args=(connection, hz, sent), daemon=True).start()


def publish(connection: socket.socket, hz: float, sent: Counter[str]) -> None:
    """Shake hands, then send frames until the subscriber leaves; count them before they are sent."""
    with connection:
        topic = receive_header(connection)["topic"]
        fields = {"callerid": NAME, "topic": topic, "type": TYPE, "md5sum": MD5SUM, "latching": "0"}
        connection.sendall(header({**fields, "message_definition": "see sensor_msgs/Image"}))
        try:
            for frame in frames(struct.pack("<I", len(IMAGE) + SIZE) + IMAGE, hz):
                sent[topic] += 1
                connection.sendall(frame)
        except OSError:
            return


def header(fields: dict[str, str]) -> bytes:
    """Return a TCPROS connection header."""
    lines = [f"{name}={value}".encode() for name, value in fields.items()]
    body = b"".join(struct.pack("<I", len(line)) + line for line in lines)
    return struct.pack("<I", len(body)) + body


def receive_header(connection: socket.socket) -> dict[str, str]:
    """Return the fields of a subscriber's connection header."""
    (length,) = struct.unpack("<I", connection.recv(4, socket.MSG_WAITALL))
    body, at, fields = connection.recv(length, socket.MSG_WAITALL), 0, {}
    while at < length:
        (size,) = struct.unpack_from("<I", body, at)
        name, _, value = body[at + 4 : at + 4 + size].decode().partition("=")
        fields[name] = value
        at += 4 + size
    return fields


if __name__ == "__main__":
    main()
