import msgspec
import numpy as np
import pytest
from backports import zstd

from schemas import codec
from schemas.budget import RateBudget
from schemas.camera_info import CameraInfo, Region
from schemas.codec import Message
from schemas.detections import Box, ClassCount, ClassList, Detection, Detections, Mask
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from schemas.inventory import ClassSighting, InventoryAnswer, InventoryRequest, SiteTotals, WarehouseReport
from schemas.keys import CameraKey, RobotStreamKey
from schemas.models import (
    ModelPiece,
    ModelPieceRequest,
    ModelRegistry,
    ModelUpload,
    ModelUploadAnswer,
    ModelUse,
    PictureRequest,
    PublishedModel,
    SavedPicture,
)
from schemas.points import PointCloud, PointField
from schemas.ros import RawMessage, ServiceRequest, ServiceResponse, Text
from schemas.status import CameraLoad, ClockReading, GatewayStatus, ReturnStatus, StreamStatus, WorkerStatus
from schemas.transforms import Transform, Transforms
from schemas.tuning import Tuning
from schemas.world import WorldRequest
from tests.schemas import world
from tests.schemas.frames import header, image
from tests.schemas.pictures import compressed, file_of
from tests.schemas.results import action, alert, cloud, clouds, distances, known, unknown

DETECTIONS = Detections(
    header=header(),
    height=4,
    width=6,
    objects=[Detection(name="box", score=0.9, box=Box(0, 0, 2.5, 3), mask=Mask((4, 6), "08"))],
    model="m",
    worker="w",
    spans={"model": 12},
)
POINTS = PointCloud(
    header=header(),
    height=1,
    width=2,
    fields=[PointField("x", 0, 7), PointField("rgb", 4, 2, 3)],
    is_bigendian=False,
    point_step=8,
    row_step=16,
    data=memoryview(bytes(range(16))),
    is_dense=True,
)
RAW = RawMessage(
    header=msgspec.structs.replace(header(), camera=""),
    type="std_msgs/UInt8",
    md5="7c8164229e7d2c17eb95e9231617fdee",
    definition="uint8 data",
    latched=True,
    data=memoryview(b"\x05"),
)
MODEL = PublishedModel(digest="ab" * 32, name="site-2", size=6, by="ann@desk", about="boxes", published_ns=4)
QUESTIONS = (Tuning, InventoryRequest, WorldRequest)
"""Whose fields may all be left out."""

MESSAGES: list[Message] = [
    Tuning(confidence=0.5, classes=["box"]),
    ModelRegistry(models=[MODEL], in_force="ab" * 32, canary="cd" * 32, robots=["r1"]),
    ModelPieceRequest(digest="ab" * 32, index=3),
    ModelPiece(digest="ab" * 32, index=3, data=memoryview(b"\x05")),
    ModelUpload(model=MODEL, index=0, data=memoryview(b"\x05")),
    ModelUploadAnswer(missing=[1, 2]),
    ModelUse(digest="", robots=["r1"], leaving="0" * 64),
    PictureRequest(robot="r1", camera="front", by="ann"),
    SavedPicture(file="train/images/r1-front_1.jpg", folder="/data/site", objects=2),
    SavedPicture(file="train/images/r1-front_2.jpg", folder="/data/site"),
    ClockReading(robot="r1", boot_id="b", clock_id="c", received_ns=1, sent_ns=2, ros_ns=3),
    ServiceRequest(type="std_srvs/SetBool", md5="09fb03525b03e7ea1fd3992bafd87e16", argument=True, timeout_s=0.5),
    ServiceRequest(data=b"\x05", timeout_s=5),
    ServiceResponse(type="a/B", md5="c" * 32, success=False, message="no", data=memoryview(b"\x00")),
    InventoryRequest(robot="r1", name="box", in_view=True),
    InventoryAnswer(
        now_ns=3,
        sightings=[
            ClassSighting(
                robot="r1",
                camera="front",
                name="box",
                count=2,
                score=0.5,
                first_ns=1,
                last_ns=2,
                nearest_m=2.5,
                model="m",
                worker="w",
                available=True,
            )
        ],
        complete=False,
    ),
    WarehouseReport(
        warehouse="berlin",
        version="1",
        sent_ns=3,
        page="https://berlin.example",
        robots=3,
        robots_online=2,
        cameras=6,
        cameras_online=4,
        workers=5,
        in_view={"box": 9},
        sites=[SiteTotals(site="hall-2", current=True, objects={"box": 4})],
        alerts={"info": 2},
        problems=["the history is not being kept"],
    ),
    image(),
    compressed(file_of(np.zeros((4, 6), np.uint16), ".png"), "32FC1", 24, inverse_depth=(1.5, -2.0)),
    CameraInfo(
        header=header(),
        height=480,
        width=640,
        distortion_model="plumb_bob",
        d=[0.5, -0.25],
        k=[float(number) for number in range(9)],
        r=[1.0] * 9,
        p=[2.0] * 12,
        roi=Region(width=3, do_rectify=True),
    ),
    POINTS,
    compressed(zstd.compress(bytes(96)), "32FC1", 24, kind="zstd"),
    msgspec.structs.replace(POINTS, data=memoryview(zstd.compress(bytes(POINTS.data))), format="zstd"),
    Text(header=msgspec.structs.replace(header(), camera=""), text="ready"),
    RAW,
    Transforms(
        header=msgspec.structs.replace(header(), camera=""),
        transforms=[
            Transform(
                frame_id="map",
                child_frame_id="base",
                stamp_ns=5,
                translation=(1.0, 2.0, 3.0),
                rotation=(0.0, 0.0, 0.0, 1.0),
            )
        ],
    ),
    DETECTIONS,
    ClassList(header=header(), classes=[ClassCount("box", 2, 0.5)], model="m", worker="w"),
    distances(known("box", 2.5), unknown("pallet", 1)),
    world.view(world.viewed()),
    world.CHANGES,
    world.ANSWER,
    world.REQUEST,
    world.NEARBY,
    world.STATUS,
    world.FLOOR,
    clouds(cloud((0.0, 0.5, 2.0), rgb=b"rgb")),
    alert(),
    action(),
    GatewayStatus(
        robot="r1",
        boot_id="b",
        clock_id="c",
        sent_ns=1,
        streams=[
            StreamStatus(camera="front", stream="color", topic="/t", wanted=True, publishers=1, received=3, forwarded=2)
        ],
        returns=[
            ReturnStatus(
                camera="front", stream="classes", topic="/t", wanted=True, subscribers=1, received=3, published=2
            )
        ],
    ),
    WorkerStatus(
        service="detector",
        worker="w",
        model="m",
        sent_ns=1,
        cameras=[
            CameraLoad(robot="r1", camera="front", inferred=1, dropped={"replaced": 2}, serving=True, budget_hz=2.5)
        ],
    ),
    RateBudget(robot="r1", camera="front", consumer="w1", stream="color", hz=2.5, wait_s=0.4),
    RateBudget(robot="r1", camera="front", consumer="w1", stream="color"),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_every_message_survives_the_wire(message: Message) -> None:
    schema = type(message)
    assert codec.decode(schema, codec.encode(message), codec.encoding(schema)) == message


@pytest.mark.parametrize("message", [image(), POINTS, RAW], ids=lambda message: type(message).__name__)
def test_pixels_and_points_are_a_view_into_the_payload(message: ImageFrame | PointCloud | RawMessage) -> None:
    payload = codec.encode(message)
    assert codec.decode(type(message), payload, codec.encoding(type(message))).data.obj is payload


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 85), (2, 43), (5, 4369), (2, 10_923), (480, 640)])
def test_pieces_are_what_the_message_is(height: int, width: int) -> None:
    row = width * POINTS.point_step
    data = memoryview(bytes(height * row))
    points = msgspec.structs.replace(POINTS, height=height, width=width, row_step=row, data=data)
    for message in (image(height=height, width=width), points):
        head, data, tail = codec.encode_in_pieces(message)
        assert data is message.data
        assert head + data + tail == codec.encode(message)


FRAMES = [message for message in MESSAGES if isinstance(message, ImageFrame | PointCloud)]


@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: f"{type(frame).__name__}-{frame.format}")
def test_pieces_are_what_any_frame_is(frame: ImageFrame | PointCloud) -> None:
    assert b"".join(codec.encode_in_pieces(frame)) == codec.encode(frame)


def test_a_frame_of_an_older_writer_is_raw_and_little_endian() -> None:
    fields = msgspec.to_builtins(image(), builtin_types=(memoryview,))
    for later in ("is_bigendian", "format", "inverse_depth"):
        del fields[later]
    payload = msgspec.msgpack.encode(fields)
    assert codec.decode(ImageFrame, payload, codec.encoding(ImageFrame)) == image()


def test_unknown_fields_are_ignored_and_missing_new_ones_have_defaults() -> None:
    fields = msgspec.to_builtins(DETECTIONS)
    del fields["spans"]
    payload = msgspec.msgpack.encode({**fields, "later": [1, {"more": None}]})
    assert codec.decode(Detections, payload, codec.encoding(Detections)).spans == {}


def test_another_schema_or_version_is_refused() -> None:
    payload = codec.encode(DETECTIONS)
    for encoded_as in ("", "application/msgpack", codec.encoding(ClassList), codec.encoding(Detections)[:-1] + "2"):
        with pytest.raises(SchemaError, match=r"expected 'application/msgpack;fleetsight\.Detections\.v1'"):
            codec.decode(Detections, payload, encoded_as)


def test_size_is_checked_before_content(monkeypatch: pytest.MonkeyPatch) -> None:
    payload = codec.encode(DETECTIONS)
    monkeypatch.setitem(codec.MAX_BYTES, Detections, len(payload))
    codec.decode(Detections, payload, codec.encoding(Detections))
    monkeypatch.setitem(codec.MAX_BYTES, Detections, len(payload) - 1)
    with pytest.raises(SchemaError, match=f"Detections of {len(payload)} bytes"):
        codec.decode(Detections, payload, codec.encoding(Detections))


@pytest.mark.parametrize(
    "payload",
    [b"", b"\xc1", b"\x91" * 50_000, b"\x81\xa1x" + b"\x91" * 50_000, b"\xdf\xff\xff\xff\xff", b"\xa1\xff"],
    ids=["empty", "invalid", "deep", "deep unknown field", "huge map", "not utf-8"],
)
@pytest.mark.parametrize("schema", list(codec.MAX_BYTES))
def test_garbage_is_a_schema_error(schema: type[Message], payload: bytes) -> None:
    with pytest.raises(SchemaError, match=f"not a {schema.__name__}"):
        codec.decode(schema, payload, codec.encoding(schema))


@pytest.mark.parametrize("schema", [schema for schema in codec.MAX_BYTES if schema not in QUESTIONS])
def test_a_message_without_its_fields_is_a_schema_error(schema: type[Message]) -> None:
    with pytest.raises(SchemaError, match=f"not a {schema.__name__}"):
        codec.decode(schema, b"\x80", codec.encoding(schema))


def test_a_tuning_may_leave_every_field_open() -> None:
    assert codec.decode(Tuning, b"\x80", codec.encoding(Tuning)) == Tuning()


def test_a_wrong_layout_is_a_schema_error_on_the_wire_too() -> None:
    fields = msgspec.to_builtins(image(), builtin_types=(memoryview,))
    payload = msgspec.msgpack.encode({**fields, "height": 5})
    with pytest.raises(SchemaError, match="data does not fit: 72 bytes, step x height is 90"):
        codec.decode(ImageFrame, payload, codec.encoding(ImageFrame))


@pytest.mark.parametrize("field", ["robot", "camera"])
@pytest.mark.parametrize("name", ["r1/x", "r1\n", "\n"])
def test_a_name_that_cannot_be_a_key_chunk_is_refused(field: str, name: str) -> None:
    fields = msgspec.to_builtins(DETECTIONS)
    fields["header"][field] = name
    with pytest.raises(SchemaError, match=field):
        codec.decode(Detections, msgspec.msgpack.encode(fields), codec.encoding(Detections))


def test_identity_is_the_keys() -> None:
    codec.check_identity(header(), CameraKey("r1", "front"))
    codec.check_identity(msgspec.structs.replace(header(), camera=""), RobotStreamKey("r1", "tf"))
    for other in (CameraKey("r2", "front"), CameraKey("r1", "rear"), RobotStreamKey("r1", "tf")):
        with pytest.raises(SchemaError, match=f"header says r1/front, the key says {other}"):
            codec.check_identity(header(), other)


def test_a_message_to_a_robot_is_its_keys() -> None:
    codec.check_robot("r1", RobotStreamKey("r1", "alerts"))
    with pytest.raises(SchemaError, match="it is for r2, the key says fleet/r1/alerts"):
        codec.check_robot("r2", RobotStreamKey("r1", "alerts"))
