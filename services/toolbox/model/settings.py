"""Settings of `fleetsight model`."""

from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import AfterValidator, Field, ValidationInfo, model_validator

from bus.settings import BusSettings
from bus.sharing.settings import RobotName
from schemas.errors import SchemaError
from schemas.keys import check_name
from schemas.models import MAX_CANARY_ROBOTS
from schemas.printing import printable
from services.data_folder import IMAGE_SUFFIXES
from services.detector.settings import LEAST_SIDE, MOST_SIDE, SHIPPED, shipped_path
from services.option_names import given_as_options

OWN: Final = {
    "robots": "use",
    "name": "publish",
    "json_": "list",
    "output": "export",
    "image_size": "export",
    "int8": "export",
    "nms": "export",
}
"""The task of each option that only one has."""


def _name(text: str) -> str:
    try:
        if text:
            check_name("model", text)
    except SchemaError as error:
        raise ValueError(str(error)) from error
    return text


class ModelSettings(BusSettings):
    """Roll out a model to all detectors with `--model fleet`, through the registry of `fleetsight monitor --models`.

    export makes an ONNX file of weights, with their refiner, that detectors without torch run; it asks no registry.
    publish sends a file of weights to the registry. use puts a published model in force for the whole fleet; with
    --robots it is a canary: only the cameras of those robots are looked at with it. back ends a canary, or else puts
    the model in force that was before, once. list shows the models, and which workers run which. Exit code 1 and one
    line say why nothing was done.
    """

    task: Annotated[Literal["export", "publish", "list", "use", "back"], Field(description="what to do")]
    target: Annotated[
        str, Field(description="export, publish: the file; use: a model's name, or the beginning of its digest")
    ] = ""
    name: Annotated[
        str, AfterValidator(_name), Field(description="name of the published model; by default that of the file")
    ] = ""
    robots: Annotated[
        list[RobotName],
        Field(max_length=MAX_CANARY_ROBOTS, description="robots of a canary; by default the model is for all"),
    ] = []
    output: Annotated[
        Path | None, Field(description="file to export to; by default that of the weights, with the suffix .onnx")
    ] = None
    image_size: Annotated[
        int | None,
        Field(ge=LEAST_SIDE, le=MOST_SIDE, description="longer side of the exported input; by default as trained"),
    ] = None
    nms: Annotated[bool | None, Field(description="export the head with or without NMS; see `fleetsight detector`")] = (
        None
    )
    int8: Annotated[
        Path | None,
        Field(
            description="folder of pictures (.jpg, .jpeg, .png; 164 at least, like those of the cameras): export INT8"
            " networks too, calibrated on some of them, if they find nearly the same in the others"
        ),
    ] = None
    json_: Annotated[bool, Field(alias="json", description="list as one JSON object")] = False
    timeout_s: Annotated[float, Field(gt=0, le=60, description="seconds to wait for the monitor's answer")] = 10.0

    @model_validator(mode="after")
    def _fits_the_task(self, info: ValidationInfo) -> Self:
        for option, task in OWN.items():
            if self.task != task and option in given_as_options(self, info):
                raise ValueError(f"{self.task} takes no --{option.strip('_')}; only {task} does")
        if (self.task in {"export", "publish", "use"}) != bool(self.target):
            wanted = {
                "export": "a file: fleetsight model export best.pt",
                "publish": "a file: fleetsight model publish best.pt",
                "use": "a model: fleetsight model use NAME",
            }
            raise ValueError(
                f"{self.task} needs {wanted[self.task]}" if not self.target else f"{self.task} takes no name"
            )
        if self.task in {"export", "publish"} and not self.file.is_file():
            file = printable(self.target)
            raise ValueError(f"{file}: {'a folder' if Path(self.target).is_dir() else 'no such file'}")
        if self.task == "publish":
            self._check_name()
        if self.task == "export":
            self._check_output()
        return self

    @property
    def pictures(self) -> list[Path]:
        """The pictures in the folder of --int8 and in folders below it."""
        if self.int8 is None:
            return []
        return sorted(each for each in self.int8.rglob("*") if each.suffix.lower() in IMAGE_SUFFIXES)

    def _check_output(self) -> None:
        if self.int8 is not None and not self.int8.is_dir():
            raise ValueError(f"--int8 {printable(str(self.int8))}: no such folder")
        output = printable(str(self.exported_file))
        if self.exported_file.suffix.lower() != ".onnx":
            raise ValueError(f"--output {output}: the name of an ONNX file ends in .onnx")
        try:
            if not self.exported_file.parent.is_dir() or self.exported_file.is_dir():
                raise ValueError(f"--output {output}: a file in a folder that exists is needed")
            if self.exported_file.exists() and self.exported_file.samefile(self.file):
                raise ValueError(f"--output {output}: that is the file to export, which would be lost")
        except OSError as error:
            raise ValueError(f"--output {output}: {error.strerror}") from error

    def _check_name(self) -> None:
        try:
            _name(self.published_name)
        except ValueError as error:
            raise ValueError(f"{error}; --name gives the model another one than its file has") from error

    @property
    def file(self) -> Path:
        """The file to export or publish."""
        return Path(shipped_path(f"{SHIPPED}.pt" if self.target == SHIPPED else self.target))

    @property
    def exported_file(self) -> Path:
        """Where the exported model goes."""
        return self.output or Path(self.target).with_suffix(".onnx")

    @property
    def published_name(self) -> str:
        """The name under which the file is published."""
        return self.name or Path(self.target).stem
