"""The public names of `fleetsight`, all in one place; `import fleetsight` loads it when it is used first."""

from bus import LATEST, BusSettings
from fleetsight.arguments import QUEUE
from fleetsight.connecting import connect
from fleetsight.errors import (
    AnswerTimeoutError,
    CertificateError,
    ClosedError,
    ConnectError,
    FleetsightError,
    MessageError,
    NoMonitorError,
    NoWorkerError,
    NoWorldModelError,
    RefusedError,
    SchemaError,
    SettingsError,
)
from fleetsight.fleet import Fleet
from fleetsight.own_model import Find
from fleetsight.own_results import Results
from fleetsight.presence import Change, Roster, WorkerName
from fleetsight.streams import Stream, StreamCounts
from schemas.alerts import Alert, AlertState, Severity
from schemas.detections import Box, ClassCount, ClassList, Detection, Detections, Mask
from schemas.distances import Distances, Measured, ObjectDistance
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.inventory import ClassSighting, InventoryAnswer
from schemas.keys import CameraKey
from schemas.objects import ObjectCloud, ObjectClouds
from schemas.world import WorldAnswer, WorldObject

__all__ = [
    "LATEST",
    "QUEUE",
    "Alert",
    "AlertState",
    "AnswerTimeoutError",
    "Box",
    "BusSettings",
    "CameraKey",
    "CertificateError",
    "Change",
    "ClassCount",
    "ClassList",
    "ClassSighting",
    "ClosedError",
    "ConnectError",
    "Detection",
    "Detections",
    "Distances",
    "Find",
    "Fleet",
    "FleetsightError",
    "Header",
    "ImageFrame",
    "InventoryAnswer",
    "Mask",
    "Measured",
    "MessageError",
    "NoMonitorError",
    "NoWorkerError",
    "NoWorldModelError",
    "ObjectCloud",
    "ObjectClouds",
    "ObjectDistance",
    "RefusedError",
    "Results",
    "Roster",
    "SchemaError",
    "SettingsError",
    "Severity",
    "Stream",
    "StreamCounts",
    "WorkerName",
    "WorldAnswer",
    "WorldObject",
    "connect",
]
