"""Made up objects of a drive, in pictures of 200 x 100 pixels."""

from benchmarks.accuracy.drives import Seen
from tests.services.training.evaluation.pictures import mask

Place = tuple[int, int, int, int]


def seen(identity: int, place: Place, *, name: str = "box", asked_for: bool = True) -> Seen:
    """Return an object seen in a rectangle: left, top, right, bottom."""
    return Seen(identity=identity, name=name, mask=mask(*place), asked_for=asked_for)
