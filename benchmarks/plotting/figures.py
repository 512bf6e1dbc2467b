"""The figures of a benchmark's record, by name. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from benchmarks.running.record import middle


class NoFigureError(Exception):
    """A record lacks what a picture is of; the message says what."""


@dataclass(frozen=True, slots=True)
class Bar:
    """A value and how far it is spread: from the least to the greatest."""

    value: float
    least: float
    greatest: float


@dataclass(frozen=True, slots=True)
class Figures:
    """What a benchmark found."""

    record: Mapping[str, Any]

    def bar(self, *path: str) -> Bar:
        """Return a figure, with its spread over the benchmark's runs, or within its only run where that is known.

        Raises:
            NoFigureError: there is none.
        """
        found = self._at(*path)
        try:
            value = middle(found)
        except ValueError as error:
            raise NoFigureError(f"{self._named(path)}: {error}") from error
        if isinstance(found, Mapping):
            return Bar(value, float(found["min"]), float(found["max"]))
        spread = self.record["figures"].get("spread", {}).get(path[0]) if len(path) == 1 else None
        match spread:
            case [int() | float() as least, int() | float() as greatest]:
                return Bar(value, float(least), float(greatest))
        return Bar(value, value, value)

    def value(self, *path: str) -> float:
        """Return a figure's median.

        Raises:
            NoFigureError: there is none.
        """
        return self.bar(*path).value

    def table(self, name: str) -> list["Figures"]:
        """Return the rows of a figure that is a list of objects.

        Raises:
            NoFigureError: there is none.
        """
        rows = self._at(name)
        if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
            raise NoFigureError(f"{self._named((name,))}: no table")
        return [Figures({**self.record, "figures": row}) for row in rows]

    def has(self, name: str) -> bool:
        """Whether a figure could be measured."""
        return self.record.get("figures", {}).get(name) is not None

    def text(self, name: str) -> str:
        """Return a figure that is a word.

        Raises:
            NoFigureError: there is none.
        """
        return str(self._at(name))

    def limit(self, target: str) -> float:
        """Return what was aimed at.

        Raises:
            NoFigureError: there is no such target.
        """
        try:
            aimed: Mapping[str, float] = self.record["targets"][target]
            return float(aimed["at_most"] if "at_most" in aimed else aimed["at_least"])
        except KeyError as error:
            raise NoFigureError(f"{self._named((target,))}: no such target") from error

    def source(self) -> str:
        """Return on what and when it was measured, for beneath a picture."""
        machine = self.record.get("machine", {})
        about = f"{machine.get('cores', '?')} cores, {machine.get('cpu', 'unknown processor')}"
        return f"{about}, {str(self.record.get('date', ''))[:10]}"

    def _at(self, *path: str) -> Any:
        found: Any = self.record.get("figures", {})
        for name in path:
            if not isinstance(found, Mapping) or name not in found:
                raise NoFigureError(f"{self._named(path)}: no such figure")
            found = found[name]
        return found

    def _named(self, path: tuple[str, ...]) -> str:
        return f"{self.record.get('benchmark', 'a record')}: {'.'.join(path)}"
