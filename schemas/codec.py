"""Encodes and decodes messages: MessagePack, schema name and version in the Zenoh encoding, bounded decoding."""

import struct
from itertools import islice
from typing import Any, Final, TypeVar

import msgspec

from schemas import keys
from schemas.alerts import Action, Alert
from schemas.budget import RateBudget
from schemas.camera_info import CameraInfo
from schemas.detections import ClassList, Detections
from schemas.distances import CameraView, Distances
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.inventory import InventoryAnswer, InventoryRequest, WarehouseReport
from schemas.models import (
    ModelPiece,
    ModelPieceRequest,
    ModelRegistry,
    ModelUpload,
    ModelUploadAnswer,
    ModelUse,
    PictureRequest,
    SavedPicture,
)
from schemas.objects import ObjectClouds
from schemas.points import PointCloud
from schemas.ros import RawMessage, ServiceRequest, ServiceResponse, Text
from schemas.status import ClockReading, GatewayStatus, WorkerStatus
from schemas.transforms import Transforms
from schemas.tuning import Tuning
from schemas.world import FloorLooks, NearbyObjects, SiteStatus, WorldAnswer, WorldChanges, WorldRequest

Message = (
    ImageFrame
    | CameraInfo
    | PointCloud
    | Transforms
    | Text
    | RawMessage
    | Detections
    | ClassList
    | Distances
    | CameraView
    | ObjectClouds
    | Alert
    | Action
    | GatewayStatus
    | WorkerStatus
    | RateBudget
    | ClockReading
    | ServiceRequest
    | ServiceResponse
    | Tuning
    | InventoryRequest
    | InventoryAnswer
    | WorldChanges
    | NearbyObjects
    | SiteStatus
    | FloorLooks
    | WorldRequest
    | WorldAnswer
    | WarehouseReport
    | ModelRegistry
    | ModelPieceRequest
    | ModelPiece
    | ModelUpload
    | ModelUploadAnswer
    | ModelUse
    | PictureRequest
    | SavedPicture
)
M = TypeVar("M", bound=Message)

VERSION: Final = 1
KIB: Final = 1024
MAX_BYTES: Final[dict[type, int]] = {
    ImageFrame: 128 * KIB * KIB,
    CameraInfo: 64 * KIB,
    PointCloud: 128 * KIB * KIB,
    Transforms: 16 * KIB * KIB,
    Text: 1024 * KIB,
    RawMessage: 128 * KIB * KIB,
    Detections: 16 * KIB * KIB,
    ClassList: 256 * KIB,
    Distances: 16 * KIB * KIB,
    CameraView: 1024 * KIB,
    ObjectClouds: 64 * KIB * KIB,
    Alert: 64 * KIB,
    Action: 512 * KIB,
    GatewayStatus: 1024 * KIB,
    WorkerStatus: 1024 * KIB,
    RateBudget: 64 * KIB,
    ClockReading: 64 * KIB,
    ServiceRequest: 9 * KIB * KIB,
    ServiceResponse: 9 * KIB * KIB,
    Tuning: 1024 * KIB,
    InventoryRequest: 64 * KIB,
    InventoryAnswer: 16 * KIB * KIB,
    WorldChanges: 4 * KIB * KIB,
    NearbyObjects: 4 * KIB * KIB,
    SiteStatus: 1024 * KIB,
    FloorLooks: 4 * KIB * KIB,
    WorldRequest: 64 * KIB,
    WorldAnswer: 16 * KIB * KIB,
    WarehouseReport: 256 * KIB,
    ModelRegistry: 256 * KIB,
    ModelPieceRequest: 64 * KIB,
    ModelPiece: 1024 * KIB,
    ModelUpload: 1024 * KIB,
    ModelUploadAnswer: 64 * KIB,
    ModelUse: 128 * KIB,
    PictureRequest: 64 * KIB,
    SavedPicture: 64 * KIB,
}
"""Maximum payload size per message type, checked before a byte of it is read."""

_encodings: Final[dict[type, str]] = {
    schema: f"application/msgpack;fleetsight.{schema.__name__}.v{VERSION}" for schema in MAX_BYTES
}
_encoder: Final = msgspec.msgpack.Encoder()
_MAP: Final = 0x80
"""MessagePack's first byte of a map of up to 15 fields, with how many; no message has more."""

_decoders: Final[dict[type, msgspec.msgpack.Decoder[Any]]] = {
    schema: msgspec.msgpack.Decoder(schema) for schema in MAX_BYTES
}


def encoding(schema: type[msgspec.Struct]) -> str:
    """Return the Zenoh encoding that names the schema of a payload."""
    return _encodings[schema]


def encode(message: Message) -> bytes:
    """Serialise a message."""
    return _encoder.encode(message)


def encode_in_pieces(message: ImageFrame | PointCloud) -> tuple[bytes, memoryview, bytes]:
    """Serialise a message without copying its data: the three pieces, joined, equal the result of `encode`."""
    fields = msgspec.structs.asdict(message)
    at = list(fields).index("data") + 1
    before, after = dict(islice(fields.items(), at)), dict(islice(fields.items(), at, None))
    data, before["data"] = message.data, b""
    head, tail = _encoder.encode(before), _encoder.encode(after)
    return bytes([_MAP | len(fields)]) + head[1:-2] + _bin(data.nbytes), data, tail[1:]


def _bin(size: int) -> bytes:
    """Return MessagePack's header for this many bytes."""
    if size < 1 << 8:
        return struct.pack(">BB", 0xC4, size)
    if size < 1 << 16:
        return struct.pack(">BH", 0xC5, size)
    return struct.pack(">BI", 0xC6, size)


def decode(schema: type[M], payload: bytes | memoryview, encoded_as: str) -> M:
    """Deserialise and validate a payload; pixel data stays a view into it.

    Raises:
        SchemaError: another schema or version, too large, or not what the schema says. Nothing else.
    """
    if encoded_as != encoding(schema):
        raise SchemaError(f"encoded as {encoded_as[:100]!r}, expected {encoding(schema)!r}")
    if len(payload) > MAX_BYTES[schema]:
        raise SchemaError(f"{schema.__name__} of {len(payload)} bytes, at most {MAX_BYTES[schema]} are read")
    try:
        message: M = _decoders[schema].decode(payload)
    except (msgspec.MsgspecError, RecursionError, UnicodeError, OverflowError) as error:
        raise SchemaError(f"not a {schema.__name__}: {error}") from error
    return message


def check_identity(header: Header, of: keys.CameraKey | keys.RobotStreamKey) -> None:
    """Check a message against its key.

    Raises:
        SchemaError: the header speaks of another robot or camera.
    """
    camera = of.camera if isinstance(of, keys.CameraKey) else ""
    if (header.robot, header.camera) != (of.robot, camera):
        raise SchemaError(f"header says {header.robot[:64]}/{header.camera[:64]}, the key says {of}")


def check_robot(robot: str, of: keys.RobotStreamKey) -> None:
    """Check a message without a header against its key.

    Raises:
        SchemaError: it speaks of another robot.
    """
    if robot != of.robot:
        raise SchemaError(f"it is for {robot[:64]}, the key says {of}")
