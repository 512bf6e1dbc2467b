"""The fleet's results to ROS 1 messages: one translator per returned stream."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from gateway.ros1.messages import new_message, serialise
from schemas.detections import MAX_DETECTIONS, ClassList
from schemas.errors import SchemaError
from schemas.keys import Stream

STRING: Final = "std_msgs/String"

R = TypeVar("R", bound=ClassList)


@dataclass(frozen=True, slots=True)
class Translator(Generic[R]):
    """Makes messages of one ROS type from one stream of results.

    topic: below the camera's result namespace. translate: returns the serialised ROS message.
        Raises SchemaError or MessageError for a result that cannot become one.
    """

    stream: Stream
    schema: type[R]
    topic: str
    ros_type: str
    translate: Callable[[R], bytes]


def classes(seen: ClassList) -> bytes:
    """Translate a ClassList to a std_msgs/String: a Python list of names, one entry per object.

    Raises:
        SchemaError: more objects than one image can have, so that a short message cannot become a long one.
    """
    total = sum(each.count for each in seen.classes)
    if total > MAX_DETECTIONS:
        raise SchemaError(f"{total} objects in one image, at most {MAX_DETECTIONS} are returned")
    names = [each.name for each in seen.classes for _ in range(each.count)]
    return serialise(STRING, new_message(STRING, data=repr(names)))


CLASSES: Final = Translator(Stream.CLASSES, ClassList, "detection/classes", STRING, classes)
RETURNED: Final = (CLASSES,)
"""Every stream that a gateway returns for each camera."""
