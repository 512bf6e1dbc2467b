"""The training run as a command."""

from services.simulator.training import process
from services.simulator.training.settings import TrainingSettings
from services.toolbox.train.inference import open_weights
from services.toolbox.train.refinement import REFINEMENT


async def run(settings: TrainingSettings) -> None:
    """Train, and evaluate through the detector's own inference.

    Raises:
        TrainingError: the work directory belongs to a run with other settings.
    """
    await process.run(settings, open_weights, REFINEMENT)
