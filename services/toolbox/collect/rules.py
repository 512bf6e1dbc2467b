"""Rules that say when a picture of a camera is worth taking. Pure."""

from collections.abc import Collection
from dataclasses import dataclass, field

from schemas.detections import ClassList


@dataclass(frozen=True, slots=True)
class Rules:
    """When to take pictures.

    unsure: the scores between which the best score of a class counts as unsure. appears: classes that come into view.
    disagree: the fleet's model and the one under trial see other classes in the same frame.
    """

    unsure: tuple[float, float]
    appears: Collection[str] = ()
    disagree: bool = False


@dataclass(slots=True)
class CameraRules:
    """The rules for one camera, and what was seen of it last."""

    rules: Rules
    _in_view: frozenset[str] | None = None
    _frames: dict[bool, ClassList] = field(default_factory=dict)

    def seen(self, classes: ClassList) -> str | None:
        """Return why a list of the fleet's model asks for a picture, None if it does not."""
        names = frozenset(each.name for each in classes.classes)
        before, self._in_view = self._in_view, names
        low, high = self.rules.unsure
        for each in classes.classes:
            if low <= each.score <= high:
                return f"unsure: {each.name} {each.score:.2f}"
        if before is not None and (new := sorted((names - before).intersection(self.rules.appears))):
            return f"appears: {', '.join(new)}"
        return self._compared(classes, of_opinion=False)

    def opinion(self, classes: ClassList) -> str | None:
        """Return why a list of the model under trial asks for a picture, None if it does not."""
        return self._compared(classes, of_opinion=True)

    def _compared(self, classes: ClassList, *, of_opinion: bool) -> str | None:
        if not self.rules.disagree:
            return None
        self._frames[of_opinion] = classes
        other = self._frames.get(not of_opinion)
        if other is None or _frame(other) != _frame(classes):
            return None
        only = {each.name for each in classes.classes} ^ {each.name for each in other.classes}
        return f"models disagree: {', '.join(sorted(only))}" if only else None


def _frame(classes: ClassList) -> tuple[str, int]:
    return classes.header.boot_id, classes.header.seq
