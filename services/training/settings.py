"""Settings of a training run."""

from pathlib import Path
from typing import Any, Final, Self

from pydantic import BaseModel, ConfigDict, Field, PositiveInt, field_validator, model_validator

WEIGHTS_FOLDER = Path(__file__).parents[1] / "detector" / "weights"
DECISIVE: Final = {
    "seed",
    "images",
    "holdout",
    "coarse_epochs",
    "epochs",
    "polish_epochs",
    "refiner_images",
    "refiner_epochs",
    "imgsz",
    "batch",
    "data",
    "collages",
    "data_epochs",
    "data_rate",
    "keep",
    "freeze",
    "patience",
    "class_names",
    "only_refiner",
    "start",
}
"""The settings that determine the weights and their metrics on any machine."""

FINE_TUNING: Final = {"images": 600, "refiner_images": 1500, "refiner_epochs": 1}
"""Defaults of a run that begins with given weights: an afternoon on two cores, not a night."""

MOST_WORKERS: Final = 1024
"""Torch's OpenMP has no stack for a hundred times as many threads."""


class TrainingSettings(BaseModel):
    """Train a model on rendered pictures of the simulated warehouse, and on photographs where --data names some.

    Renders, trains, evaluates, and writes the weights and their card. From scratch that takes hours without a GPU;
    --from begins with given weights and trains on the mix of photographs and rendered pictures alone. Stopped at any
    time, the same command goes on from its last epoch.
    """

    model_config = ConfigDict(validate_by_name=True, validate_by_alias=True)

    seed: int = Field(
        default=1, ge=0, description="seed of the scenes and the training; the same seed gives the same data"
    )
    images: PositiveInt = Field(
        default=6000, description="images to train on, two of each scene; 600 with --from unless given"
    )
    holdout: PositiveInt = Field(default=300, description="images of other scenes to evaluate on, never trained on")
    coarse_epochs: int = Field(default=4, ge=0, description="first passes over the images, at half the size")
    epochs: PositiveInt = Field(default=2, description="passes over the images at their whole size")
    polish_epochs: int = Field(
        default=3, ge=0, description="last passes at the whole size, with the learning rate raised once more"
    )
    refiner_images: int = Field(
        default=12000,
        ge=0,
        description="images of further scenes to train the refiner on, 1.6 MB on disk each; 0 for no refiner; 1500 with"
        " --from unless given",
    )
    refiner_epochs: PositiveInt = Field(
        default=5,
        description="passes of the refiner over the objects found in these; rare classes are drawn more often; 1 with"
        " --from unless given",
    )
    data: list[Path] = Field(
        default=[],
        max_length=100,
        description="folder of labelled photographs to train on, too: train/images, train/labels (YOLO's form), and"
        " val or test to evaluate on; incomplete.txt and boxes_only.txt say what is not labelled",
    )
    data_epochs: PositiveInt = Field(
        default=12, description="passes over photographs and rendered pictures together, the last stage"
    )
    collages: int = Field(
        default=300,
        ge=0,
        description="pictures made for that stage: objects of the photographs on photographs without any, and up to"
        " an eighth as many empty plain pictures",
    )
    data_rate: float = Field(
        default=4e-4, gt=0, le=0.1, description="learning rate that this stage begins with; it falls to a fiftieth"
    )
    start: Path | None = Field(
        default=None,
        alias="from",
        description="weights to begin with, instead of from scratch: the shipped ones, or others of Ultralytics' that"
        " find boxes or masks; needs --data or --only-refiner",
    )
    only_refiner: bool = Field(
        default=False,
        description="train nothing but the refiner, anew, of the weights that --from names, which stay as they are;"
        " photographs of --data are then to evaluate on alone",
    )
    class_names: dict[str, str] = Field(
        default={},
        description="other names for classes of the simulator and of the weights to begin with, such as"
        " 'box=parcel,pallet=skid', where the photographs' data.yaml has those",
    )
    freeze: int = Field(
        default=0,
        ge=0,
        le=100,
        description="first layers of the model to leave as they are in that stage: faster, and less is forgotten and"
        " learned; 11 are yolo11's backbone",
    )
    patience: int = Field(
        default=0,
        ge=0,
        description="end that stage when the photographs in val or test have fared no better for so many epochs, and"
        " take the best epoch; 0 for all of --data-epochs",
    )
    keep: float = Field(
        default=0.0,
        ge=0,
        lt=1,
        description="share of the weights that it began with in the result, which is the average of both: more of it"
        " keeps more of what these did well; needs --from",
    )
    imgsz: PositiveInt = Field(default=640, multiple_of=32, description="longer side of the model's input in pixels")
    batch: PositiveInt = Field(default=8, description="images per step")
    workers: int = Field(
        default=2, ge=1, le=MOST_WORKERS, description="processes that render, and threads that train without a GPU"
    )
    device: str = Field(default="auto", description="auto (a GPU if there is one), cpu, or a GPU number such as 0")
    output: Path = Field(
        default=WEIGHTS_FOLDER / "warehouse-n-seg.pt",
        description="file for the weights; beside it the model card (.md) and the mistakes on photographs (.html)",
    )
    work_dir: Path = Field(
        default=Path("runs/warehouse-n-seg"),
        description="folder for data set and checkpoints; an interrupted run with the same settings resumes here",
    )

    @model_validator(mode="before")
    @classmethod
    def _takes_less_with_given_weights(cls, given: Any) -> Any:
        begins = isinstance(given, dict) and (given.get("from") or given.get("start"))
        return {**FINE_TUNING, **given} if begins and not given.get("only_refiner") else given

    @model_validator(mode="after")
    def _has_something_to_train_on(self) -> Self:
        if self.only_refiner:
            if self.start is None:
                raise ValueError("--only-refiner: name the weights whose refiner it is with --from")
            if self.keep or self.class_names:
                raise ValueError("--only-refiner: leave --keep and --class-names out; the model stays as it is")
            if not self.refiner_images:
                raise ValueError("--only-refiner: with --refiner-images 0 it has nothing to learn from")
        elif self.start is not None and not self.data:
            raise ValueError("--from: nothing new to train on; name a folder of photographs with --data")
        if self.keep and self.start is None:
            raise ValueError("--keep: there are no weights to keep a share of; name them with --from")
        if self.class_names and not self.data:
            raise ValueError("--class-names: the simulator's names are those of its pictures; name folders with --data")
        return self

    @field_validator("output")
    @classmethod
    def _is_a_file_of_weights(cls, output: Path) -> Path:
        if output.suffix != ".pt" or output.is_dir():
            raise ValueError("not a file of weights; use a name that ends in .pt")
        return output
