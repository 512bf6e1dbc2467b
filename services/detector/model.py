"""What a worker asks of a model, whichever library runs it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

from schemas.detections import Detection, Detections
from schemas.header import Spans
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from schemas.tuning import Tuning

SILENT: Final = "overlay/segmentation, distances and objects are silent"
"""How a remark ends that says of a model that it has no masks."""


class ModelError(Exception):
    """A model that cannot be used, or no longer; the message says which and why."""


class TuningError(Exception):
    """A tuning that the model cannot follow; the message says why."""


def first_line(error: Exception) -> str:
    """Return the first line of what an error says, with its kind where that is a key or a number and no words."""
    kind = type(error).__name__
    line = next((line.strip() for line in str(error).splitlines() if line.strip()), kind)
    return line if " " in line or line == kind else f"{kind}: {line}"


@dataclass(frozen=True, slots=True)
class Request:
    """One image to look at. masks: whether anybody has a use for them."""

    camera: CameraKey
    frame: ImageFrame
    masks: bool


@dataclass(frozen=True, slots=True)
class DetectedObjects:
    """The objects of one image, best score first, and nanoseconds per stage."""

    objects: list[Detection]
    spans: Spans = field(default_factory=dict)

    def detections(self, frame: ImageFrame, *, model: str, worker: str, **before: int) -> Detections:
        """Return them as a message about a frame. before: nanoseconds of stages before the model's."""
        return Detections(
            header=frame.header,
            height=frame.height,
            width=frame.width,
            objects=self.objects,
            model=model,
            worker=worker,
            spans={**before, **self.spans},
        )


@dataclass(frozen=True, slots=True)
class Failed:
    """An image that nothing can be said about. reason: one of `services.detector.frame_counts`."""

    reason: str
    error: Exception


Outcome = DetectedObjects | Failed


class Model(Protocol):
    """A loaded detection or segmentation model."""

    @property
    def name(self) -> str:
        """What results say they come from; at most MAX_LABEL characters."""

    @property
    def max_batch(self) -> int:
        """Most images that are worth one call; at least 1."""

    @property
    def in_flight(self) -> int:
        """How many calls should be under way at once, so that one is prepared while another computes; at least 1."""

    @property
    def segments(self) -> bool:
        """Whether it finds masks at all."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """What whoever waits for results should know, each in a line: which results there cannot be, and why."""

    @property
    def tuning(self) -> Tuning:
        """What counts as a detection now."""

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the classes that are reported now when they are in view."""

    def tune(self, tuning: Tuning) -> None:
        """Count by another tuning from the next image on; what it leaves open stays as it is.

        Raises:
            TuningError: it names a class that the model does not know.
        """

    def close(self) -> None:
        """Compute nothing more; what is under way is not waited for."""

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """Return what is in each image, in the same order. Calls end in the order in which they began.

        A bad image fails alone. Masks come with the objects of the images they were asked for, if the model has them.

        Raises:
            ModelError: the model is of no more use to anybody.
        """
