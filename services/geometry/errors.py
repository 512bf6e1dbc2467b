"""Every error this package raises on purpose; the text of each is a reason that fits a result's `unknown`.

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
    """What is asked cannot be known from what is there. Its text is at most MAX_LABEL characters long."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason[:MAX_LABEL])


class CalibrationError(GeometryError):
    """A CameraInfo that no pixel can be placed with, or one of another picture."""


class DepthError(GeometryError):
    """An image that holds no depth that can be read."""


class MaskError(GeometryError):
    """Runs that are no mask of their size."""


class PayloadError(GeometryError):
    """Compressed data that is damaged."""


class TransformError(GeometryError):
    """Two frames of reference whose relation at a time is not known."""


class UnknownFrameError(TransformError):
    """Nothing was ever said of a frame."""


class UnconnectedError(TransformError):
    """Both frames are known, but nothing leads from one to the other."""


class LoopError(TransformError):
    """A frame is its own ancestor."""


class TooOldError(TransformError):
    """The stamp is before what is kept of a transform."""


class TooNewError(TransformError):
    """The stamp is after what is known of a transform so far; it may become known."""


class SilentError(TransformError):
    """The stamp is so long after what is known of a transform that nobody seems to say it any more."""
