"""The stages of a training run: first small images, the most efficient, then full size, then full size again.

The last stage begins at a higher rate than the one before it ended with (a warm restart: Loshchilov and Hutter,
"SGDR", 2017), and lets it fall over all its epochs. A
stage may end early, with its best epoch as the result: `BestEpoch`.
"""

import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import BaseModel, ValidationError

from services.training.files import TrainingError, keep_file
from services.training.settings import TrainingSettings

Judge = Callable[[Path], float]
"""Says how good a checkpoint is: the higher the better."""

NEVER: Final = -1


@dataclass(frozen=True, slots=True)
class TrainingStage:
    """Epochs at one size of the model's input; the learning rate falls from `first_rate` to `last_rate`.

    hold: epochs before the rate begins to fall, then with every batch; None has Ultralytics let it fall once an epoch.
    mixed: photographs are trained on, too.
    """

    name: str
    imgsz: int
    epochs: int
    first_rate: float
    last_rate: float
    hold: int | None = None
    mixed: bool = False

    def checkpoint(self, work_dir: Path) -> Path:
        """The path of the state after the last whole epoch; always a complete file, unlike Ultralytics' own."""
        return work_dir / f"{self.name}.pt"

    def rate(self, epochs: float) -> float:
        """The learning rate's share of `first_rate` after so many epochs: half a cosine, once it falls."""
        hold, last = self.hold or 0, self.last_rate / self.first_rate
        gone = min(max(epochs - hold, 0) / max(self.epochs - hold, 1), 1)
        return last + (1 - last) * (1 + math.cos(math.pi * gone)) / 2


def stages_of(settings: TrainingSettings) -> tuple[TrainingStage, ...]:
    """The stages in their order; the last one's checkpoint is the run's."""
    half, rate = -(-settings.imgsz // 64) * 32, settings.data_rate
    mixed = TrainingStage("mixed", settings.imgsz, settings.data_epochs, rate, rate / 50, hold=0, mixed=True)
    last = (mixed,) if settings.data else ()
    if settings.start is not None:
        return last
    coarse = TrainingStage("coarse", half, settings.coarse_epochs, 2e-3, 5e-4)
    fine = TrainingStage("fine", settings.imgsz, settings.epochs, 1.5e-3, 3e-5, hold=1)
    polish = TrainingStage("polish", settings.imgsz, settings.polish_epochs, 8e-4, 1e-5, hold=0)
    return (*(stage for stage in (coarse, fine, polish) if stage.epochs), *last)


class _Record(BaseModel):
    """The last epoch that was judged and the best one, from 0, and how good that was."""

    last: int = NEVER
    best: int = NEVER
    figure: float = 0.0


class BestEpoch:
    """The best epoch of a stage so far, in files beside its checkpoint, so that an interrupted run goes on with it."""

    def __init__(self, checkpoint: Path, patience: int, judge: Judge) -> None:
        """checkpoint: of the stage's last epoch. patience: epochs to wait for a better one.

        Raises:
            TrainingError: the record of a run before cannot be read.
        """
        self.checkpoint = checkpoint.with_stem(f"{checkpoint.stem}-best")
        self._latest, self._patience, self._judge = checkpoint, patience, judge
        self._file = self.checkpoint.with_suffix(".json")
        try:
            self._record = _Record.model_validate_json(self._file.read_bytes()) if self._file.exists() else _Record()
        except (OSError, ValidationError) as error:
            raise TrainingError(f"{self._file}: not a record of a run; remove it") from error

    @property
    def waited_enough(self) -> bool:
        """Whether so many epochs have passed since the best one; not before one was any good."""
        return self._record.figure > 0 and self._record.last - self._record.best >= self._patience

    def catch_up(self, epoch: int) -> None:
        """Judge the checkpoint, which is of an epoch, where a run was interrupted before it was judged."""
        if self._record.last < epoch:
            self.add(epoch)

    def add(self, epoch: int) -> None:
        """Judge the checkpoint, which is of an epoch, and keep it if it is the best so far."""
        figure = self._judge(self._latest)
        if figure > self._record.figure or not self._record.figure:
            partial = self.checkpoint.with_suffix(".part")
            shutil.copyfile(self._latest, partial)
            partial.replace(self.checkpoint)
            self._record = _Record(last=epoch, best=epoch, figure=figure)
        else:
            self._record = self._record.model_copy(update={"last": epoch})
        keep_file(self._file, self._record.model_dump_json().encode())
