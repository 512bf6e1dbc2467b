"""Capture what a real rospy sends; run with the Python that Debian's rospy is installed for. See README.md."""

import http.client
import os
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import xmlrpc.client
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from xmlrpc.server import SimpleXMLRPCServer

FOLDER = Path(__file__).parent
TOPIC = "/camera/image_raw"
LOOPBACK = "127.0.0.1"

PUBLISHER = """
import rospy
from sensor_msgs.msg import Image
rospy.init_node("golden_publisher", disable_rosout=True)
publisher = rospy.Publisher("/camera/image_raw", Image, queue_size=1, latch=True)
image = Image(height=3, width=4, encoding="rgb8", is_bigendian=0, step=12, data=bytes(range(36)))
image.header.stamp = rospy.Time(1700000000, 123456789)
image.header.frame_id = "camera_link"
publisher.publish(image)
rospy.spin()
"""

SUBSCRIBER = """
import rospy
from sensor_msgs.msg import Image
rospy.init_node("golden_subscriber", disable_rosout=True)
rospy.Subscriber("/camera/image_raw", Image, tcp_nodelay=True)
rospy.spin()
"""

SERVICE = """
import rospy
from std_srvs.srv import Trigger, TriggerResponse
def fail(_):
    raise ValueError("on purpose")
rospy.init_node("golden_service", disable_rosout=True)
rospy.Service("/good", Trigger, lambda _: TriggerResponse(True, "done"))
rospy.Service("/bad", Trigger, fail)
rospy.spin()
"""


def free_port() -> int:
    with socket.create_server((LOOPBACK, 0)) as probe:
        port: int = probe.getsockname()[1]
        return port


def recording_proxy(master_port: int) -> ThreadingHTTPServer:
    """Forward XML-RPC to the master and keep registerPublisher's two bodies."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            master = http.client.HTTPConnection(LOOPBACK, master_port)
            master.request("POST", "/RPC2", body, {"Content-Type": "text/xml"})
            answer = master.getresponse().read()
            if b"<methodName>registerPublisher<" in body:
                (FOLDER / "registerPublisher.xml").write_bytes(body)
                (FOLDER / "registerPublisher-response.xml").write_bytes(answer)
            self.send_response(200)
            self.send_header("Content-Type", "text/xml")
            self.send_header("Content-Length", str(len(answer)))
            self.end_headers()
            self.wfile.write(answer)

        def log_message(self, *_: object) -> None:
            pass

    return ThreadingHTTPServer((LOOPBACK, 0), Handler)


def wait_for(call: Callable[..., Any], *arguments: object) -> Any:
    for _ in range(100):
        try:
            code, _, value = call(*arguments)
            if code == 1:
                return value
        except OSError:
            pass
        time.sleep(0.1)
    sys.exit("no answer")


def read_frame(connection: socket.socket) -> bytes:
    prefix = connection.recv(4, socket.MSG_WAITALL)
    return prefix + connection.recv(struct.unpack("<I", prefix)[0], socket.MSG_WAITALL)


def header(**fields: str) -> bytes:
    texts = [f"{key}={value}".encode() for key, value in fields.items()]
    body = b"".join(struct.pack("<I", len(text)) + text for text in texts)
    return struct.pack("<I", len(body)) + body


def capture_publisher(master: xmlrpc.client.ServerProxy) -> None:
    uri = wait_for(master.lookupNode, "/capture", "/golden_publisher")
    slave = xmlrpc.client.ServerProxy(uri)
    _, host, port = wait_for(slave.requestTopic, "/capture", TOPIC, [["TCPROS"]])
    asked = {"callerid": "/capture", "topic": TOPIC, "type": "sensor_msgs/Image"}
    with socket.create_connection((host, port)) as connection:
        connection.sendall(header(md5sum="*", **asked))
        (FOLDER / "publisher-header.bin").write_bytes(read_frame(connection))
        (FOLDER / "image.bin").write_bytes(read_frame(connection))
    with socket.create_connection((host, port)) as connection:
        connection.sendall(header(md5sum="0" * 32, **asked))
        (FOLDER / "publisher-refusal.bin").write_bytes(read_frame(connection))


def capture_subscriber(master: xmlrpc.client.ServerProxy) -> None:
    with socket.create_server((LOOPBACK, 0)) as listener:
        answer = [1, "ready", ["TCPROS", LOOPBACK, listener.getsockname()[1]]]
        slave = SimpleXMLRPCServer((LOOPBACK, 0), logRequests=False)
        slave.register_function(lambda *_: answer, "requestTopic")
        threading.Thread(target=slave.serve_forever, daemon=True).start()
        uri = f"http://{LOOPBACK}:{slave.server_address[1]}/"
        wait_for(master.registerPublisher, "/capture", TOPIC, "sensor_msgs/Image", uri)
        connection, _ = listener.accept()
        with connection:
            (FOLDER / "subscriber-header.bin").write_bytes(read_frame(connection))


def capture_service(master: xmlrpc.client.ServerProxy) -> None:
    for service, file in (("/bad", "service-failure.bin"), ("/good", "service-answer.bin")):
        with ask_service(master, service, "*") as connection:
            (FOLDER / "service-header.bin").write_bytes(read_frame(connection))
            connection.sendall(struct.pack("<I", 0))
            (FOLDER / file).write_bytes(connection.recv(1) + read_frame(connection))
    with ask_service(master, "/good", "0" * 32) as connection:
        (FOLDER / "service-refusal.bin").write_bytes(read_frame(connection))


def ask_service(master: xmlrpc.client.ServerProxy, service: str, md5sum: str) -> socket.socket:
    uri = wait_for(master.lookupService, "/capture", service)
    host, _, port = uri.removeprefix("rosrpc://").rpartition(":")
    connection = socket.create_connection((host, int(port)))
    connection.sendall(header(callerid="/capture", service=service, md5sum=md5sum))
    return connection


def main() -> None:
    port = free_port()
    proxy = recording_proxy(port)
    threading.Thread(target=proxy.serve_forever, daemon=True).start()
    uri = f"http://{LOOPBACK}:{proxy.server_address[1]}/"
    logs = tempfile.mkdtemp()
    variables = {**os.environ, "ROS_MASTER_URI": uri, "ROS_IP": LOOPBACK, "ROS_LOG_DIR": logs, "ROS_HOME": logs}
    running = [subprocess.Popen(["/usr/bin/rosmaster", "--core", "-p", str(port)], env=variables)]
    try:
        master = xmlrpc.client.ServerProxy(f"http://{LOOPBACK}:{port}/")
        wait_for(master.getPid, "/capture")
        running.append(subprocess.Popen([sys.executable, "-c", PUBLISHER], env=variables))
        capture_publisher(master)
        running.append(subprocess.Popen([sys.executable, "-c", SUBSCRIBER], env=variables))
        capture_subscriber(master)
        running.append(subprocess.Popen([sys.executable, "-c", SERVICE], env=variables))
        capture_service(master)
    finally:
        for process in running:
            process.kill()
            process.wait()


if __name__ == "__main__":
    main()
