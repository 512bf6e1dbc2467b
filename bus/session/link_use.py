"""How many links a process has, and how many it may have: Zenoh (1.10) refuses further ones without a word. Pure."""

from dataclasses import dataclass
from typing import Final

MAX_LINKS: Final = 10_000
"""Links of one process at most; Zenoh's own default is 1,000."""

OTHER_FILES: Final = 256
"""Open files that a process needs for anything else: each link is a file, too."""

_NEARLY_ALL: Final = 0.9
_CALM: Final = 0.8
"""Shares of the links that a process may have: when it warns, and below which it may warn again."""


@dataclass(frozen=True, slots=True)
class LinkUse:
    """Links of a process to others: how many there are, and how many there can be."""

    count: int
    limit: int

    @property
    def problem(self) -> str:
        """Why others soon cannot connect, and what helps, in words; empty while there is room."""
        if self.count < _NEARLY_ALL * self.limit:
            return ""
        more = "" if self.limit >= MAX_LINKS else "let it open more files (LimitNOFILE in its unit, ulimit -n), or "
        return (
            f"{self.count:,} of at most {self.limit:,} links are in use, further ones are refused: "
            f"{more}have some robots and workers connect through another router"
        )


class LinkWarning:
    """Warns when nearly all links are taken, and not again before some have gone."""

    def __init__(self) -> None:
        self._said = False

    def news(self, use: LinkUse) -> str:
        """Return what is to be said now that so many links are there, or nothing."""
        problem = use.problem
        if not problem:
            self._said = self._said and use.count >= _CALM * use.limit
            return ""
        if self._said:
            return ""
        self._said = True
        return problem


def most_links(files: int) -> int:
    """Return how many links a process may have that may open so many files."""
    return max(1, min(MAX_LINKS, files - OTHER_FILES))
