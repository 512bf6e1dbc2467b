"""What a model makes of the held-out pictures."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from services.simulator.training.evaluation.class_lists import ListScore
from services.simulator.training.evaluation.precision import MaskScore
from services.simulator.training.evaluation.predictor import Predictor
from services.simulator.training.evaluation.scenes import HeldOutView


@dataclass(frozen=True, slots=True)
class HeldOutScore:
    """The pictures seen, as masks and as class lists."""

    masks: MaskScore = field(default_factory=MaskScore)
    lists: ListScore = field(default_factory=ListScore)


def scored(views: Iterable[HeldOutView], predict: Predictor, report: Callable[[int], None]) -> HeldOutScore:
    """Show each picture to `predict`, which returns even the least likely detections, and report how many are done."""
    score = HeldOutScore()
    for done, view in enumerate(views, start=1):
        image = view.image()
        found = predict(image)
        score.masks.add((image.shape[0], image.shape[1]), view.truths, found)
        score.lists.add(view.truths, found)
        report(done)
    return score
