"""Settings of `fleetsight detect`."""

from pathlib import Path
from typing import Annotated, Final, Self

from pydantic import AfterValidator, Field, ValidationInfo, model_validator

from bus.settings import BusSettings
from schemas.printing import printable
from services.detector.settings import (
    SHIPPED,
    DetectorSettings,
    InferenceSettings,
    Runtime,
    check_is_file,
    is_weights,
    shipped_file,
    shipped_path,
)
from services.option_names import given_as_options

SUFFIXES: Final = ("", ".jpg", ".jpeg")
"""Of a JPEG file; a device has none."""


LOCAL: Final = {"model", "detection_model", "download", "runtime", *InferenceSettings.model_fields} - {
    "cache",
    "device",
    "threads",
}
"""Settings that change what --local finds, and say nothing to a worker. As options they are refused without --local; in
an environment or a file, which other commands share, they may stand."""


class DetectSettings(InferenceSettings, BusSettings):
    """Detect the objects in an image.

    Asks one of the fleet's detector workers, any that is not busy; with --local a model of this process. Prints a line
    per object, best score first, and then writes the image with the objects drawn over it. Exit code 1 and one line say
    why there is no answer, or nothing is drawn.
    """

    image: Annotated[Path, Field(description="image file; the first argument if no option is")]
    output: Annotated[
        Path | None,
        Field(
            description="JPEG file to draw the objects in, whatever was in it;"
            " photo.detected.jpg for photo.jpg unless given"
        ),
    ] = None
    json_: Annotated[bool, Field(alias="json", description="print one JSON object instead of a table")] = False
    local: Annotated[bool, Field(description="run the model here, without a fleet")] = False
    model: Annotated[
        Annotated[str, AfterValidator(shipped_path)] | None,
        Field(description="weights or an exported model for --local; the shipped one unless given"),
    ] = None
    detection_model: Annotated[
        Annotated[str, AfterValidator(shipped_path)] | None,
        Field(description="second model for --local, for boxes; its objects get the masks of --model"),
    ] = None
    download: Annotated[bool, Field(description="let Ultralytics download missing weights for --local")] = False
    runtime: Annotated[
        Runtime | None,
        Field(
            description="what computes with --local; by default torch for weights, which it need not export, and auto"
            " for exported models"
        ),
    ] = None
    timeout_s: Annotated[float, Field(gt=0, le=60, description="seconds to wait for a worker and its answer")] = 10.0

    @model_validator(mode="after")
    def _reads_and_writes(self, info: ValidationInfo) -> Self:
        try:
            self._check_files()
        except OSError as error:  # a name that is too long, a folder that may not be looked into
            raise ValueError(f"{printable(str(error.filename))}: {error.strerror}") from error
        if not self.local and (given := sorted(LOCAL & given_as_options(self, info))):
            raise ValueError(f"--{given[0].replace('_', '-')} is for --local: workers have their own")
        return self

    def _check_files(self) -> None:
        if not self.image.is_file():
            wrong = "not a file" if self.image.exists() else "no such file"
            raise ValueError(f"--image {printable(str(self.image))}: {wrong}")
        drawing = printable(str(self.drawing))
        if not self.drawing.parent.is_dir():
            raise ValueError(f"--output {drawing}: {printable(str(self.drawing.parent))} is no folder")
        if self.drawing.is_dir():
            raise ValueError(f"--output {drawing}: a folder")
        if self.drawing.exists() and self.drawing.samefile(self.image):
            raise ValueError(f"--output {drawing}: that is the image, which would be lost")
        if self.drawing.suffix.lower() not in SUFFIXES:
            raise ValueError(f"--output {drawing}: what is written is JPEG: .jpg")
        for option, weights in (("--model", self.model), ("--detection-model", self.detection_model)):
            if self.local and weights is not None and not self.download and (option, weights) != ("--model", SHIPPED):
                check_is_file(option, weights)

    @property
    def of_model(self) -> DetectorSettings:
        """The settings of the model that runs here."""
        chosen = {name: getattr(self, name) for name in InferenceSettings.model_fields}
        boxes = self.detection_model
        wanted = self.runtime or ("torch" if boxes is not None and is_weights(boxes) else None)
        model = str(shipped_file(self.device, wanted)) if self.model in (None, SHIPPED) else self.model
        weights = all(is_weights(each) for each in (model, boxes) if each is not None)
        return DetectorSettings(
            model=model,
            detection_model=boxes,
            download=self.download,
            runtime=self.runtime or ("torch" if weights else "auto"),
            **chosen,
        )

    @property
    def drawing(self) -> Path:
        """The file to draw the objects in."""
        return self.output or self.image.with_name(f"{self.image.stem}.detected.jpg")
