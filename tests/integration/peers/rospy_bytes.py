"""Publishes given bytes as messages with rospy, ten times a second; run under the system's Python.

Arguments: TOPIC=TYPE:MESSAGE, the type such as sensor_msgs/Image and the serialised message in hexadecimal.
"""

import sys
from importlib import import_module
from typing import Any

import rospy


def as_sent(said: str) -> Any:
    """Return a message of the type that serialises to the given bytes, whatever its class would make of them."""
    kind, data = said.split(":")
    package, name = kind.split("/")
    known: Any = getattr(import_module(f"{package}.msg"), name)

    class Sent(known):  # type: ignore[misc]
        def serialize(self, buff: Any) -> None:
            buff.write(bytes.fromhex(data))

    return Sent()


messages = {topic: as_sent(said) for topic, said in (argument.split("=", 1) for argument in sys.argv[1:])}
rospy.init_node("odd_driver", anonymous=True)
publishers = {topic: rospy.Publisher(topic, type(message), queue_size=2) for topic, message in messages.items()}
sys.stdout.write("bytes up\n")
sys.stdout.flush()
ticks = rospy.Rate(10)
while not rospy.is_shutdown():
    for topic, publisher in publishers.items():
        publisher.publish(messages[topic])
    ticks.sleep()
