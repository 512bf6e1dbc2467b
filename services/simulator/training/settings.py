"""What a training run can be told."""

from pathlib import Path

from pydantic import BaseModel, Field, PositiveInt

WEIGHTS_FOLDER = Path(__file__).parents[2] / "detector" / "weights"


class TrainingSettings(BaseModel):
    """Settings of `train`; the defaults make the weights that are shipped."""

    seed: int = Field(
        default=1, ge=0, description="Seed of the scenes and of the training; the same seed, the same data."
    )
    images: PositiveInt = Field(default=6000, description="Images to train on, two of each scene.")
    holdout: PositiveInt = Field(default=300, description="Images of other scenes to evaluate on, never trained on.")
    coarse_epochs: int = Field(default=4, ge=0, description="First passes over the images, at half the size.")
    epochs: PositiveInt = Field(default=2, description="Passes over the images at their whole size.")
    polish_epochs: int = Field(
        default=3, ge=0, description="Last passes at the whole size, the learning rate raised once more to fall slowly."
    )
    imgsz: PositiveInt = Field(default=640, multiple_of=32, description="Longer side of the model's input in pixels.")
    batch: PositiveInt = Field(default=8, description="Images per step.")
    workers: PositiveInt = Field(default=2, description="Processes that render, and threads that train without a GPU.")
    device: str = Field(
        default="auto", description='"auto" (a GPU if there is one), "cpu", or a GPU number such as "0".'
    )
    output: Path = Field(
        default=WEIGHTS_FOLDER / "warehouse-n-seg.pt",
        description="Where the weights go; the model card goes beside them.",
    )
    work_dir: Path = Field(
        default=Path("runs/warehouse-n-seg"),
        description="Data set and checkpoints; an interrupted run with the same settings goes on from here.",
    )
