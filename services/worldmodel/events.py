"""Changes of objects as a model finds them, and objects that were told to be gone. Pure."""

from collections import deque
from dataclasses import dataclass
from typing import Final

from schemas.world import ChangeKind

BACK_M: Final = 0.3
CELL_M: Final = 1.0
BACK_NS: Final = 60_000_000_000
MOST_GONE: Final = 10_000


@dataclass(frozen=True, slots=True)
class Event:
    """An object, by its row and the number of its id, changed. robot: number of the one that saw it.

    before: where it was. into: number of the one that it merged into.
    """

    kind: ChangeKind
    row: int
    number: int
    at_ns: int
    robot: int
    before: tuple[float, float, float] | None = None
    into: int | None = None


class Gone:
    """Objects that went a short while ago: one of their class at their place is the same one."""

    def __init__(self) -> None:
        self._gone: deque[tuple[int, int, int]] = deque()
        self._cells: dict[int, tuple[int, int, int]] = {}
        self._at: dict[tuple[int, int, int], dict[int, tuple[float, float, float]]] = {}

    def add(self, number: int, cls: int, at: tuple[float, float, float], at_ns: int) -> None:
        """Remember an object."""
        cell = _cell(cls, at[0], at[1])
        self._gone.append((at_ns, number, cls))
        self._cells[number] = cell
        self._at.setdefault(cell, {})[number] = at

    def take(self, cls: int, at: tuple[float, float, float], at_ns: int) -> int | None:
        """Return the number of the object that is back, if one is, and forget it."""
        self._forget_old(at_ns)
        for across in (-BACK_M, BACK_M):
            for up in (-BACK_M, BACK_M):
                for number, place in self._at.get(_cell(cls, at[0] + across, at[1] + up), {}).items():
                    if max(abs(one - other) for one, other in zip(at, place, strict=True)) < BACK_M:
                        self._forget(number)
                        return number
        return None

    def classes(self, at_ns: int) -> set[int]:
        """Return the classes of objects that may be back."""
        self._forget_old(at_ns)
        return {cls for cls, _, _ in self._at}

    def _forget_old(self, at_ns: int) -> None:
        while self._gone and (self._gone[0][0] < at_ns - BACK_NS or len(self._gone) > MOST_GONE):
            self._forget(self._gone.popleft()[1])

    def _forget(self, number: int) -> None:
        cell = self._cells.pop(number, None)
        if cell is not None:
            del self._at[cell][number]
            if not self._at[cell]:
                del self._at[cell]


def _cell(cls: int, x: float, y: float) -> tuple[int, int, int]:
    return cls, int(x // CELL_M), int(y // CELL_M)
