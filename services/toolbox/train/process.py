"""Runs the training as a command."""

from services.toolbox.train.inference import open_weights
from services.toolbox.train.refinement import REFINEMENT
from services.training import process
from services.training.settings import TrainingSettings


async def run(settings: TrainingSettings) -> None:
    """Train, and evaluate through the detector's own inference.

    Raises:
        TrainingError: the work directory belongs to a run with other settings.
    """
    await process.run(settings, open_weights, REFINEMENT)
