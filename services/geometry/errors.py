"""Errors of this package; the text of each is a reason that fits a result's `unknown`.

GeometryError
├── CalibrationError
├── DepthError
├── MaskError
├── PayloadError
└── TransformError
    ├── UnknownFrameError
    ├── UnconnectedError
    ├── LoopError
    ├── TooOldError
    ├── TooNewError
    └── SilentError
"""

from schemas.header import MAX_LABEL


class GeometryError(ValueError):
    """The result cannot be computed from the data. The text is at most MAX_LABEL characters long."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason[:MAX_LABEL])


class CalibrationError(GeometryError):
    """The CameraInfo is uncalibrated or belongs to another image."""


class DepthError(GeometryError):
    """The image holds no readable depth."""


class MaskError(GeometryError):
    """The runs are not a mask of this size."""


class PayloadError(GeometryError):
    """The compressed data is damaged."""


class TransformError(GeometryError):
    """The transform between two frames at a time is unknown."""


class UnknownFrameError(TransformError):
    """The frame never occurred in any transform."""


class UnconnectedError(TransformError):
    """Both frames are known, but not connected."""


class LoopError(TransformError):
    """A frame is its own ancestor."""


class TooOldError(TransformError):
    """The stamp is older than the kept history of a transform."""


class TooNewError(TransformError):
    """The stamp is newer than the last transform; it may become known."""


class SilentError(TransformError):
    """The stamp is much newer than the last transform, which seems no longer to be published."""
