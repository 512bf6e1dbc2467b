"""Settings of a detector worker."""

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from bus.settings import BusSettings
from bus.sharing.naming import default_worker_name
from bus.sharing.settings import SharingSettings
from schemas.keys import NAME

SHIPPED_MODEL = Path(__file__).parent / "weights" / "warehouse-n-seg.pt"


class DetectorSettings(SharingSettings, BusSettings):
    """Run a YOLO model on the cameras whose results somebody wants, one call per image."""

    model: Annotated[
        str, Field(description="Ultralytics weights: a path, or with --download a published model's name")
    ] = str(SHIPPED_MODEL)
    download: Annotated[bool, Field(description="let Ultralytics fetch weights that are not here")] = False
    confidence: Annotated[float, Field(ge=0, le=1, description="lowest score that counts as a detection")] = 0.35
    iou: Annotated[float, Field(ge=0, le=1, description="overlap above which two boxes are one object")] = 0.7
    max_detections: Annotated[int, Field(ge=1, le=1000, description="most objects reported per image")] = 300
    device: Annotated[str | None, Field(description="cpu, cuda:0, ...; the best there is unless given")] = None
    threads: Annotated[int, Field(ge=0, description="CPU threads for inference; 0 uses every core")] = 0
    max_age_s: Annotated[
        float | None,
        Field(
            gt=0,
            le=60,
            description="frames older than that are left out when their turn comes; unless given, those"
            " older than one call of the model takes, and 30 ms",
        ),
    ] = None
    worker: str = Field(
        default_factory=default_worker_name, pattern=f"^{NAME.pattern}$", description="this worker's name"
    )

    @model_validator(mode="after")
    def _model_is_here(self) -> Self:
        if not self.download and not Path(self.model).is_file():
            raise ValueError(f"--model {self.model}: no such file (--download would let Ultralytics fetch it)")
        return self
