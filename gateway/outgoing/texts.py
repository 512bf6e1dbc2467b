"""Results that ROS gets as texts (std_msgs/String)."""

from typing import Final

import msgspec

from gateway.ros1.messages import new_message, serialise
from schemas.alerts import Action, Alert
from schemas.detections import MAX_DETECTIONS, ClassList
from schemas.distances import Distances
from schemas.errors import SchemaError

STRING: Final = "std_msgs/String"


def string(text: str) -> bytes:
    """Return a serialised std_msgs/String."""
    return serialise(STRING, new_message(STRING, data=text))


def classes(seen: ClassList, _: int) -> bytes:
    """Translate a ClassList: a Python list of names, one entry per object.

    Raises:
        SchemaError: more objects than one image can have, so that a short message cannot become a long one.
    """
    total = sum(each.count for each in seen.classes)
    if total > MAX_DETECTIONS:
        raise SchemaError(f"{total} objects in one image, at most {MAX_DETECTIONS} are returned")
    return string(repr([each.name for each in seen.classes for _ in range(each.count)]))


def distances(seen: Distances, _: int) -> bytes:
    """Translate Distances: a Python list of `name: 2.31m` along the optical axis; unknown ones are left out."""
    known = ((each.name, each.measured) for each in seen.objects)
    return string(repr([f"{name}: {measured.axial_m:.2f}m" for name, measured in known if measured is not None]))


def alert(said: Alert, _: int) -> bytes:
    """Translate an Alert: a JSON object of its fields."""
    return string(msgspec.json.encode(said).decode())


def action(asked: Action, _: int) -> bytes:
    """Translate an Action: its payload."""
    return string(asked.payload)
