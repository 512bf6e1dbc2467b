"""tf2_msgs/TFMessage to Transforms."""

import struct
from typing import Any, Final

from gateway.ros1.errors import MessageError
from gateway.ros1.messages import deserialise
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.translators.stream_kind import Incomplete, stamp_of
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL, Header
from schemas.transforms import MAX_TRANSFORMS, Transform, Transforms

TYPE_NAME: Final = "tf2_msgs/TFMessage"
TYPE_NAMES: Final = (TYPE_NAME, "tf/tfMessage")
"""Both types have the same definition and md5sum; tf and rosserial use the second name."""

_TOO_LONG: Final = f"frames whose names are longer than {MAX_LABEL} characters"
_COUNT: Final = struct.Struct("<I")
_Publisher = tuple[str, str]


def transforms(message: Message, header: Header) -> Transforms:
    """Translate one message's transforms."""
    found, left_out = _transforms(message)
    return _all(Transforms(header=header, transforms=found), left_out)


class StaticTransforms:
    """Merges the transforms of all publishers of a subscription; the last one of each child counts.

    So does a ROS listener. The last message of each publisher would not do: `rosbag play` sends what several recorded
    publishers latched under its one name, and a rospy node what several broadcasters did. Of all that, a new
    subscription is handed the last message alone. A publisher that sends it has not gone, so its earlier messages count
    again.
    """

    def __init__(self) -> None:
        self._known: dict[str, tuple[_Publisher, Transform]] = {}
        self._heard: set[_Publisher] = set()

    def begin(self) -> None:
        """Start a subscription: a publisher's earlier transforms count once it is heard again."""
        self._heard.clear()

    def __call__(self, message: Message, header: Header) -> Transforms:
        """Translate a message to all transforms known so far, including its own."""
        transforms, left_out = _transforms(message)
        publisher = message.uri, message.callerid
        heard = self._heard | {publisher}
        known = self._known | {found.child_frame_id: (publisher, found) for found in transforms}
        whole = {child: said for child, said in known.items() if said[0] in heard}
        if len(whole) > MAX_TRANSFORMS:
            raise SchemaError(f"static transforms of {len(whole)} frames, at most {MAX_TRANSFORMS} are kept")
        self._known = known if len(known) <= MAX_TRANSFORMS else whole
        self._heard = heard & {said_by for said_by, _ in whole.values()}  # no more publishers than transforms
        return _all(Transforms(header=header, transforms=[transform for _, transform in whole.values()]), left_out)


def _all(made: Transforms, left_out: int) -> Transforms:
    if left_out:
        raise Incomplete(made, left_out, f"transforms of {_TOO_LONG}")
    return made


def _transforms(message: Message) -> tuple[list[Transform], int]:
    """Return the transforms that can be carried, and the number of others."""
    if len(message.data) < _COUNT.size:
        raise MessageError(f"{len(message.data)} bytes are not a {TYPE_NAME}")
    (count,) = _COUNT.unpack_from(message.data)
    if count > MAX_TRANSFORMS:
        raise SchemaError(f"{count} transforms in a message, at most {MAX_TRANSFORMS} are carried")
    found = deserialise(TYPE_NAME, message.data).transforms
    carried = [each for each in found if max(len(each.header.frame_id), len(each.child_frame_id)) <= MAX_LABEL]
    if found and not carried:
        raise SchemaError(f"all transforms are of {_TOO_LONG}")
    return [_transform(each) for each in carried], len(found) - len(carried)


def _transform(found: Any) -> Transform:
    at, turned = found.transform.translation, found.transform.rotation
    return Transform(
        frame_id=found.header.frame_id,
        child_frame_id=found.child_frame_id,
        stamp_ns=stamp_of(found.header),
        translation=(at.x, at.y, at.z),
        rotation=(turned.x, turned.y, turned.z, turned.w),
    )
