"""Evidence for tests: all is well unless a test says otherwise."""

from dataclasses import replace
from typing import Any, Final

import msgspec

from gateway.doctor.evidence import (
    BusLook,
    Evidence,
    GatewayReport,
    Graph,
    Heard,
    HostLook,
    MasterLook,
    PublisherLook,
    Router,
    StreamLook,
)
from gateway.ros1.messages import message_type
from schemas import codec
from schemas.camera_info import CameraInfo
from schemas.header import Header
from schemas.image import BYTES_PER_PIXEL, ImageFrame
from schemas.keys import sensor_key
from schemas.status import GatewayStatus, StreamStatus
from schemas.transforms import Transform, Transforms

IMAGE: Final = "sensor_msgs/Image"
INFO: Final = "sensor_msgs/CameraInfo"
TF: Final = "tf2_msgs/TFMessage"
NOW_NS: Final = 1_700_000_000_000_000_000
MS: Final = 1_000_000


def header(frame_id: str = "lens") -> Header:
    return Header(robot="r1", camera="front", boot_id="b", seq=0, stamp_ns=NOW_NS, frame_id=frame_id, received_ns=0)


def image(width: int = 8, height: int = 4, encoding: str = "rgb8", frame_id: str = "lens") -> ImageFrame:
    step = width * BYTES_PER_PIXEL[encoding]
    data = memoryview(bytes(step * height))
    return ImageFrame(header=header(frame_id), height=height, width=width, encoding=encoding, step=step, data=data)


def info(width: int = 8, height: int = 4, f: float = 6.0, frame_id: str = "lens", **changes: Any) -> CameraInfo:
    made = CameraInfo(
        header=header(frame_id),
        height=height,
        width=width,
        distortion_model="plumb_bob",
        d=[],
        k=[f, 0, width / 2, 0, f, height / 2, 0, 0, 1],
        r=[0.0] * 9,
        p=[0.0] * 12,
    )
    return msgspec.structs.replace(made, **changes)


def links(*pairs: tuple[str, str]) -> Transforms:
    """Return transforms, each given by the frames of parent and child."""
    transforms = [
        Transform(frame_id=parent, child_frame_id=child, stamp_ns=0, translation=(0, 0, 0), rotation=(0, 0, 0, 1))
        for parent, child in pairs
    ]
    return Transforms(header=header(), transforms=transforms)


def heard(message: codec.Message | None = None, *, late_ms: int = 20, first_ms: int = 0, count: int = 5) -> Heard:
    """Return messages at 10 Hz, the first stamp `first_ms` after NOW_NS."""
    stamps = tuple(NOW_NS + (first_ms + 100 * n) * MS for n in range(count))
    return Heard(
        tuple(n / 10 for n in range(count)), 100, stamps, (late_ms * MS,) * count, (message,) if message else ()
    )


def publisher(type_name: str, said: Heard, **changes: Any) -> PublisherLook:
    made = PublisherLook("/camera", None, message_type(type_name).topic_type, latching=False, heard=said)
    return replace(made, **changes)


def stream(name: str, topic: str, type_name: str, *publishers: PublisherLook) -> StreamLook:
    return StreamLook(sensor_key("r1", name), topic, type_name, publishers)


def sends(name: str, topic: str, type_name: str, message: codec.Message | None = None, **changes: Any) -> StreamLook:
    """Return a stream whose only publisher sends as it should."""
    return stream(name, topic, type_name, publisher(type_name, heard(message, **changes)))


def color(**changes: Any) -> StreamLook:
    return sends("front/color", "/front/color/image_raw", IMAGE, image(**changes))


def depth(**changes: Any) -> StreamLook:
    return sends("front/depth", "/front/depth/image_raw", IMAGE, image(**{"encoding": "16UC1", **changes}))


def color_info(**changes: Any) -> StreamLook:
    return sends("front/info", "/front/color/camera_info", INFO, info(**changes))


def depth_info(**changes: Any) -> StreamLook:
    return sends("front/depth_info", "/front/depth/camera_info", INFO, info(**changes))


def graph_of(*streams: StreamLook) -> Graph:
    return Graph(
        publishers={each.topic: tuple(one.node for one in each.publishers) for each in streams if each.publishers},
        types={each.topic: each.type for each in streams if each.type},
    )


def status(*streams: StreamStatus, sent_s: float = 0.0, **changes: Any) -> GatewayStatus:
    made = GatewayStatus(robot="r1", boot_id="b", clock_id="c", sent_ns=int(sent_s * 1e9), streams=list(streams))
    return msgspec.structs.replace(made, **changes)


def counted(name: str = "front/color", topic: str = "/front/color/image_raw", **changes: Any) -> StreamStatus:
    camera, _, stream_name = name.rpartition("/")
    made = StreamStatus(
        camera=camera, stream=stream_name, topic=topic, wanted=False, publishers=0, received=0, forwarded=0
    )
    return msgspec.structs.replace(made, **changes)


def account(before: GatewayStatus, after: GatewayStatus, **changes: Any) -> GatewayReport:
    return replace(GatewayReport(before, after, 3, since_s=0.0, until_s=2.0), **changes)


def evidence(*streams: StreamLook, beside: tuple[StreamLook, ...] = (), **changes: Any) -> Evidence:
    """Return what is seen of a healthy robot with these streams."""
    offered = [counted(each.name, each.topic) for each in streams]
    one = account(status(*offered), status(*offered, sent_s=2.0))
    made = Evidence(
        robot="r1",
        seconds=3.0,
        master=MasterLook("http://robot:11311", None, graph_of(*streams, *beside)),
        host=HostLook("robot", ("192.168.0.7",), ours=True),
        bus=BusLook((Router("tcp/central:7447"),), frozenset({"r1"}), (one,)),
        streams=streams,
        beside=beside,
    )
    return replace(made, **changes)
