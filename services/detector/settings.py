"""Settings of a detector worker."""

import os
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal, Self

from pydantic import BaseModel, Field, model_validator

from bus.settings import BusSettings
from bus.sharing.settings import SharingSettings
from schemas.printing import printable
from services.detector.worker_role import OPINION

LEAST_SIDE: Final = 32
MOST_SIDE: Final = 4096
"""Of a model's input, in pixels."""

MOST_THREADS: Final = 1024

SHIPPED_MODEL = Path(__file__).parent / "weights" / "warehouse-n-seg.pt"


def default_cache() -> Path:
    """Return the user's folder for what can be made again; who has no home has one that keeps nothing."""
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fleetsight"
    except RuntimeError:  # no folder that others may write: what is kept is run
        return Path(os.devnull) / "fleetsight"


Runtime = Literal["auto", "torch", "onnx", "openvino", "tensorrt"]


class LookSettings(BaseModel):
    """Fields of every process that runs a model on images: what it counts as an object, and on what it runs."""

    heading: ClassVar = "the model"

    confidence: Annotated[float, Field(ge=0, le=1, description="only a higher score counts as a detection")] = 0.25
    iou: Annotated[float, Field(ge=0, le=1, description="overlap above which two boxes are one object")] = 0.7
    agnostic_nms: Annotated[
        bool | None,
        Field(
            description="of overlapping boxes report the best one alone, whatever their classes; unless given, only for"
            " YOLOE models, whose own default it is"
        ),
    ] = None
    nms: Annotated[
        bool | None,
        Field(
            description="suppress overlapping boxes; --no-nms uses the NMS-free head that YOLO26 and YOLOv10 models"
            " have. Unless given, boxes are suppressed wherever the model allows for it"
        ),
    ] = None
    max_detections: Annotated[int, Field(ge=1, le=1000, description="most objects reported per image")] = 300
    classes: Annotated[
        list[str], Field(description="names of the classes to report; all that the model knows unless given")
    ] = []
    refine: Annotated[
        bool,
        Field(
            description="make masks finer with the network that weights may have for that; --no-refine takes less time"
        ),
    ] = True
    image_size: Annotated[
        int | None,
        Field(
            ge=LEAST_SIDE, le=MOST_SIDE, description="longer side that images are scaled to; as trained unless given"
        ),
    ] = None
    cache: Path = Field(default_factory=default_cache, description="folder for what is made once of the weights")
    device: Annotated[str | None, Field(description="cpu, cuda:0, ...; the best there is unless given")] = None
    threads: Annotated[
        int, Field(ge=0, le=MOST_THREADS, description="CPU threads for inference; 0 uses every core")
    ] = 0


class DetectorSettings(LookSettings, SharingSettings, BusSettings):
    """Run a YOLO model on the cameras whose results somebody wants, one call per image."""

    model: Annotated[
        str, Field(description="Ultralytics weights: a path, or with --download a published model's name")
    ] = str(SHIPPED_MODEL)
    opinion: Annotated[
        bool,
        Field(
            description="try this model beside the one in force: it publishes class lists on a key of their own, for"
            " the monitor's rule disagree, and nothing else"
        ),
    ] = False
    detection_model: Annotated[
        str | None, Field(description="second weights, for boxes; what they find has the first one's masks")
    ] = None
    download: Annotated[bool, Field(description="let Ultralytics fetch weights that are not here")] = False
    runtime: Annotated[
        Runtime,
        Field(description="what computes; auto takes the fastest that is installed, by measuring once a week"),
    ] = "auto"
    tracker: Annotated[
        Literal["off", "bytetrack", "botsort"], Field(description="how objects are followed from frame to frame")
    ] = "botsort"
    track_score: Annotated[
        float | None,
        Field(
            gt=0,
            lt=1,
            description="score from which on a sighting speaks for a track, which gets its number once enough do;"
            " unless given, 0.33 for the shipped model, and for others a little below --confidence",
        ),
    ] = None
    max_age_s: Annotated[
        float | None,
        Field(
            gt=0,
            le=60,
            description="frames older than that are left out when their turn comes; unless given, those"
            " older than one call of the model takes, and 30 ms, at least 80 ms; what was late on its link by up to 2 s"
            " is no older for that while the model keeps up",
        ),
    ] = None

    @property
    def is_shipped(self) -> bool:
        """Whether the shipped model finds the objects."""
        file = Path(self.detection_model or self.model)
        return file.is_file() and file.samefile(SHIPPED_MODEL)

    @model_validator(mode="after")
    def _model_is_here(self) -> Self:
        for option, weights in (("--model", self.model), ("--detection-model", self.detection_model)):
            if weights is None or self.download:
                continue
            if Path(weights).is_dir():
                raise ValueError(f"{option} {printable(weights)}: a folder")
            if not Path(weights).is_file():
                hint = "--download would let Ultralytics fetch it"
                raise ValueError(f"{option} {printable(weights)}: no such file ({hint})")
        return self

    @model_validator(mode="after")
    def _is_no_opinions_namesake(self) -> Self:
        if not self.opinion and self.worker.startswith(OPINION.prefix):
            raise ValueError(
                f"--worker {self.worker}: to gateways {OPINION.prefix!r} begins names of --opinion workers"
            )
        return self
