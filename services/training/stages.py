"""The stages of a training run: first small images, the most efficient, then full size, then full size again.

Pure. The last stage begins at a higher rate than the one before it ended with (a warm restart: Loshchilov and Hutter,
"SGDR", 2017), and lets it fall over all its epochs.
"""

import math
from dataclasses import dataclass
from pathlib import Path

from services.training.settings import TrainingSettings


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
