"""Settings of `fleetsight labels`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, model_validator

from services.option_names import given_as_options


class Form(StrEnum):
    """The form of labels of a tool."""

    COCO = "coco"
    CVAT = "cvat"
    LABEL_STUDIO = "label-studio"
    YOLO = "yolo"


TAKES: Final = {
    "export": {"target", "to", "image_url"},
    "import": {"target", "form", "leave_empty"},
    "check": set[str](),
}
"""Settings of each task, beside `task` and `source`."""

NEEDS: Final = {
    "export": "a file to write: fleetsight labels export site tasks.json --to label-studio",
    "import": "the folder whose labels these are: fleetsight labels import project.json site",
}


class LabelsSettings(BaseModel):
    """Take the labels of a data-set folder to a labelling tool, and the corrected ones back.

    `export FOLDER OUTPUT` writes the labels of all pictures in the tool's form: COCO instances, CVAT for images 1.1, or
    tasks with drafts to accept or correct for Label Studio, and the labelling interface beside them. Pictures are not
    copied.

    `import FILE FOLDER` reads what the tool exported: one of these forms, also in the ZIP file of CVAT, or a folder or
    ZIP file in YOLO's form. Pictures are matched by file name, and each gets the labels of the file instead of its own;
    those that the file does not list stay as they are. A class that is new is added to data.yaml. A file that cannot be
    read as a whole changes nothing. labelled.jsonl says which pictures' labels a person has seen; with the folder as
    FILE, that those were corrected in it.

    `check FOLDER` counts the objects of each split, and shows which pictures have drafts that nobody corrected or no
    labels, and which labels cannot be read or have no picture. With any of them it ends with the exit code 1.
    """

    model_config = ConfigDict(validate_by_name=True, validate_by_alias=True)

    task: Annotated[Literal["export", "import", "check"], Field(description="what to do")]
    source: Annotated[
        Path, Field(description="export, check: the folder; import: the tool's file; also the second argument")
    ]
    target: Annotated[
        Path | None, Field(description="export: the file to write; import: the folder; also the third argument")
    ] = None
    to: Annotated[Literal["coco", "cvat", "label-studio"] | None, Field(description="form to export")] = None
    form: Annotated[
        Form | None, Field(alias="from", description="form to import, where the content should not tell it")
    ] = None
    leave_empty: Annotated[
        bool,
        Field(
            description="leave pictures as they are that the file lists without objects, instead of taking them as"
            " seen by a person who found none there"
        ),
    ] = False
    image_url: Annotated[
        str | None,
        Field(
            description="for label-studio: the beginning of the pictures' addresses; by default that of local files,"
            " whose document root is the folder that this folder is in"
        ),
    ] = None

    @model_validator(mode="after")
    def _has_what_its_task_takes(self, info: ValidationInfo) -> Self:
        if self.target is None and "target" in TAKES[self.task]:
            raise ValueError(f"{self.task} needs {NEEDS[self.task]}")
        if self.task == "export" and self.to is None:
            raise ValueError("export needs --to: coco, cvat or label-studio")
        given = given_as_options(self, info) - {"task", "source", *TAKES[self.task]}
        if given:
            option = {"form": "from"}.get(min(given), min(given)).replace("_", "-")
            raise ValueError(f"{self.task} takes no --{option}")
        if self.image_url is not None and "image_url" in given_as_options(self, info) and self.to != "label-studio":
            raise ValueError("--image-url is for --to label-studio")
        return self
