"""Rules that say when a picture of a camera is worth taking. Pure."""

from collections import OrderedDict
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Final

from schemas.detections import ClassList

KEPT: Final = 100
"""Lists of each model that are kept: the one under trial may be some frames behind."""


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
    _lists: dict[bool, OrderedDict[tuple[str, int], ClassList]] = field(
        default_factory=lambda: {False: OrderedDict(), True: OrderedDict()}
    )

    def seen(self, classes: ClassList) -> str | None:
        """Return why a list of the fleet's model asks for a picture, None if it does not."""
        disagree = self._compared(classes, of_opinion=False)
        names = frozenset(each.name for each in classes.classes)
        before, self._in_view = self._in_view, names
        low, high = self.rules.unsure
        for each in classes.classes:
            if low <= each.score <= high:
                return f"unsure: {each.name} {each.score:.2f}"
        if before is not None and (new := sorted((names - before).intersection(self.rules.appears))):
            return f"appears: {', '.join(new)}"
        return disagree

    def opinion(self, classes: ClassList) -> str | None:
        """Return why a list of the model under trial asks for a picture, None if it does not."""
        return self._compared(classes, of_opinion=True)

    def _compared(self, classes: ClassList, *, of_opinion: bool) -> str | None:
        if not self.rules.disagree:
            return None
        frame = classes.header.boot_id, classes.header.seq
        self._lists[of_opinion][frame] = classes
        if len(self._lists[of_opinion]) > KEPT:
            self._lists[of_opinion].popitem(last=False)
        other = self._lists[not of_opinion].get(frame)
        if other is None:
            return None
        only = {each.name for each in classes.classes} ^ {each.name for each in other.classes}
        return f"models disagree: {', '.join(sorted(only))}" if only else None
