"""Rules for tests."""

from itertools import count
from typing import Any

from schemas.keys import CameraKey
from services.monitor.inventory.sighting import Change, ChangeKind, Sighting
from services.monitor.rules.engine import MAX_SUBJECTS, RuleEngine
from services.monitor.rules.findings import CameraState
from services.monitor.rules.model import RuleBook
from tests.services.monitor.inventory.seeing import FRONT, S


def book(*rules: dict[str, Any], **more: Any) -> RuleBook:
    """Return a rule book; rules have a name and a class unless they say otherwise."""
    named = [{"name": f"rule {number}", **rule} for number, rule in enumerate(rules)]
    return RuleBook.model_validate({"timezone": "UTC", "rules": named, **more})


class Ruling:
    """An engine, and what it made of what it was told: rule, state and place of each alert that changed."""

    def __init__(self, *rules: dict[str, Any], most: int = MAX_SUBJECTS) -> None:
        numbers = count(1)
        self.engine = RuleEngine(book(*rules), lambda: str(next(numbers)), most=most)

    def changed(self, at_s: float, kind: ChangeKind, name: str = "box", *, first_look: bool = False) -> list[str]:
        at_ns = round(at_s * S)
        of = Sighting(FRONT, name, 1, 0.5, at_ns, at_ns, at_ns, "m", "w")
        self.engine.changed([Change(kind, of, first_look)], at_ns)
        return self.due(at_s)

    def look(self, at_s: float, *, key: CameraKey = FRONT, available: bool = True, **known: Any) -> list[str]:
        self.engine.look(CameraState(key, available, **known), round(at_s * S))
        return self.due(at_s)

    def due(self, at_s: float) -> list[str]:
        return [f"{each.alert.id} {each.alert.state}" for each in self.engine.due(round(at_s * S))]

    def texts(self) -> list[str]:
        return [alert.text for alert in self.engine.alerts()]
