"""Settings of `fleetsight collect`."""

import math
from pathlib import Path
from typing import Annotated, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from bus.settings import BusSettings
from fleetsight.errors import SettingsError
from fleetsight.patterns import chunk
from schemas.header import MAX_LABEL
from schemas.printing import printable


def _span(text: str) -> str:
    low, dots, high = text.partition("..")
    try:
        known = bool(dots) and 0 <= float(low) < float(high) <= 1
    except ValueError:
        known = False
    if not known:
        raise ValueError(f"{printable(text)}: write two scores from 0 to 1, such as 0.25..0.4")
    return text


def _pattern(text: str) -> str:
    try:
        chunk("name", text)
    except SettingsError as error:
        raise ValueError(str(error)) from error
    return text


Pattern = Annotated[str, AfterValidator(_pattern)]
ClassName = Annotated[str, Field(min_length=1, max_length=MAX_LABEL)]


class CollectSettings(BusSettings):
    """Save pictures of live cameras in a data-set folder, with what a model finds in them as drafts of labels.

    A picture is taken when one of the rules says so: --every-s, --unsure, --appears, --disagree, or with --asked when
    an operator presses the button on a camera's page. Cameras send nothing else than those pictures; the rules watch
    class lists. It ends at its limits, or when it is told to.
    """

    folder: Annotated[Path, Field(description="data-set folder to save to, made or continued; also the first argument")]
    robots: Annotated[Pattern, Field(description="which robots, such as r1 or 'r*'")] = "*"
    cameras: Annotated[Pattern, Field(description="which of their cameras, such as front")] = "*"
    every_s: Annotated[float | None, Field(gt=0, description="take a picture of each camera every so many seconds")] = (
        None
    )
    unsure: Annotated[
        str | None,
        AfterValidator(lambda text: None if text is None else _span(text)),
        Field(description="take one when the best score of a class is between two, such as 0.25..0.4"),
    ] = None
    appears: Annotated[
        list[ClassName], Field(description="take one when one of these classes comes into view, such as forklift")
    ] = []
    disagree: Annotated[
        bool, Field(description="take one when a detector run with --opinion sees other classes than the fleet's")
    ] = False
    asked: Annotated[
        bool, Field(description="take one when an operator asks for it on the camera's page of the monitor")
    ] = False
    rest_s: Annotated[float, Field(ge=0, description="least time between two pictures of a camera, in seconds")] = 2.0
    least_difference: Annotated[
        int,
        Field(
            ge=0,
            le=64,
            description="of 64 bits that describe a picture, how many must differ from each picture saved of the same"
            " camera; 0 saves all",
        ),
    ] = 5
    most: Annotated[int, Field(ge=1, description="number of pictures in the folder at which it ends")] = 1_000
    most_mb: Annotated[float, Field(gt=0, description="size of the pictures in the folder at which it ends, in MB")] = (
        1_000
    )
    seconds: Annotated[float | None, Field(gt=0, description="time after which it ends; by default never")] = None
    split: Annotated[str, Field(pattern=r"^(train|val|test)$", description="train, val or test")] = "train"
    names: Annotated[
        list[ClassName],
        Field(description="classes in the order of their numbers in labels; others follow as they are seen"),
    ] = ["box", "pallet", "forklift"]
    drafts: Annotated[
        bool, Field(description="have what a detector worker finds as drafts of labels; --no-drafts leaves them out")
    ] = True
    blur: Annotated[
        list[ClassName],
        Field(
            description="blur objects of these classes, such as person, as far as the fleet's model knows and finds"
            " them; without its answer nothing is saved"
        ),
    ] = []

    @field_validator("folder")
    @classmethod
    def _is_no_file(cls, folder: Path) -> Path:
        if folder.exists() and not folder.is_dir():
            raise ValueError(f"{printable(str(folder))}: no folder")
        return folder

    @model_validator(mode="after")
    def _has_a_rule(self) -> Self:
        if not (self.every_s or self.unsure or self.appears or self.disagree or self.asked):
            raise ValueError(
                "nothing says when to take a picture:"
                " give one of --every-s, --unsure, --appears, --disagree and --asked"
            )
        return self

    @property
    def unsure_span(self) -> tuple[float, float]:
        """The scores between which a class is unsure; none of them if no scores are."""
        low, _, high = (self.unsure or "").partition("..")
        return (float(low), float(high)) if high else (math.inf, -math.inf)
