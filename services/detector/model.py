"""The interface of a model to a worker, independent of the library that runs it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

from bus.sharing import watchdog
from schemas.detections import Detection, Detections
from schemas.header import Spans
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from schemas.tuning import Tuning

NO_MASKS: Final = "overlay/segmentation, distances and objects are not published"
"""The end of a remark that says that a model has no masks."""

NO_MASKS_OF_POSES: Final = "overlay/segmentation and objects are not published"
"""The same of a model whose keypoints give distances."""


class ModelError(Exception):
    """The model cannot be used, or stopped working; the message says which model and why."""


class TuningError(Exception):
    """The model cannot follow this tuning; the message says why."""


def first_line(error: Exception) -> str:
    """Return the first line of an error's text, with the error type if the text is only a key or a number.

    Lines that only introduce the next one, as OpenVINO's do, are left out.
    """
    kind = type(error).__name__
    lines = [line.strip() for line in str(error).splitlines() if line.strip()] or [kind]
    line = next((line for line in lines if not line.endswith(":")), lines[0])
    return line if " " in line or line == kind else f"{kind}: {line}"


@dataclass(frozen=True, slots=True)
class Request:
    """One image to process. masks: whether masks are wanted."""

    camera: CameraKey
    frame: ImageFrame
    masks: bool


@dataclass(frozen=True, slots=True)
class DetectedObjects:
    """The objects of one image, best score first, and nanoseconds per stage.

    model: the name of the one that found them, where several stand behind a `Model`; else empty.
    """

    objects: list[Detection]
    spans: Spans = field(default_factory=dict)
    model: str = ""

    def detections(self, frame: ImageFrame, *, model: str, worker: str, **before: int) -> Detections:
        """Return the objects as a message about a frame. before: nanoseconds of the stages before the model's.

        model: the name of the model, unless the objects say it themselves.
        """
        return Detections(
            header=frame.header,
            height=frame.height,
            width=frame.width,
            objects=self.objects,
            model=self.model or model,
            worker=worker,
            spans={**before, **self.spans},
        )


@dataclass(frozen=True, slots=True)
class Failed:
    """An image that could not be processed. reason: one of `services.detector.frame_counts`."""

    reason: str
    error: Exception


Outcome = DetectedObjects | Failed


class Model(Protocol):
    """A loaded detection or segmentation model."""

    @property
    def name(self) -> str:
        """Name of the model in results; at most MAX_LABEL characters."""

    @property
    def runtime(self) -> str:
        """Name of the runtime that the model runs under, as of `--runtime`; empty where nobody says."""

    @property
    def max_batch(self) -> int:
        """Largest useful batch; at least 1."""

    @property
    def in_flight(self) -> int:
        """Number of calls to keep in flight, so that one is prepared while another computes; at least 1."""

    @property
    def segments(self) -> bool:
        """Whether the model finds masks."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks for users, one line each: which results are unavailable, and why."""

    @property
    def tuning(self) -> Tuning:
        """The current detection criteria."""

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the classes that are currently reported."""

    def tune(self, tuning: Tuning) -> None:
        """Apply another tuning from the next image on; fields that are None stay as they are.

        Raises:
            TuningError: it names a class that the model does not know.
        """

    def close(self) -> None:
        """Stop computing, without waiting for calls in flight."""

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """Return the objects of each image, in the same order. Calls finish in the order in which they began.

        A bad image fails alone. Masks come with the objects of the images they were asked for, if the model has them.

        Raises:
            ModelError: the model is of no more use to anybody.
        """


async def end_if_hung(name: Callable[[], str], pending: Callable[[], object]) -> None:
    """Watch a model until cancelled. name: returns the model's. pending: see `unanswered`.

    Raises:
        ModelError: it does not answer any more.
    """
    async for checks in watchdog.unanswered(pending):
        if checks >= watchdog.HUNG:
            raise ModelError(f"{name()} has not answered for {watchdog.HUNG * watchdog.CHECK_S:g} s")
