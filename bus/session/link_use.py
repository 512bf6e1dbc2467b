"""Counts a process's links against its limit: Zenoh (1.10) refuses further ones silently. Pure."""

from dataclasses import dataclass
from typing import Final

MOST_FILES: Final = 65_536
"""Most open files of a process: some systems allow a billion, and programs that close all files would take forever."""

OTHER_FILES: Final = 256
"""Open files that a process needs for other things: each link is a file."""

MAX_LINKS: Final = MOST_FILES - OTHER_FILES
"""Most links of one process; Zenoh's default is 1,000."""

_NEARLY_ALL: Final = 0.9
_CALM: Final = 0.8
"""Fractions of the limit: above the first the process warns, below the second it may warn again."""


@dataclass(frozen=True, slots=True)
class LinkUse:
    """The number of links of a process, and its limit.

    strangers, copied: names of certificates that are in no access rule, and that are used at several addresses at once.
    wrong: lines about these.
    """

    count: int
    limit: int
    strangers: int = 0
    copied: int = 0
    wrong: tuple[str, ...] = ()

    @property
    def problem(self) -> str:
        """The warning that few links are left, with its remedy; empty while there is room."""
        if self.count < _NEARLY_ALL * self.limit:
            return ""
        more = "" if self.limit >= MAX_LINKS else "let it open more files (LimitNOFILE in its unit, ulimit -n), or "
        return (
            f"{self.count:,} of at most {self.limit:,} links are in use, further ones are refused: "
            f"{more}have some robots and workers connect through another router"
        )


class LinkWarning:
    """Warns once when nearly all links are in use, and again only after some have gone."""

    def __init__(self) -> None:
        self._said = False

    def news(self, use: LinkUse) -> str:
        """Return the warning for the current number of links, or an empty string."""
        problem = use.problem
        if not problem:
            self._said = self._said and use.count >= _CALM * use.limit
            return ""
        if self._said:
            return ""
        self._said = True
        return problem


def most_links(files: int) -> int:
    """Return the limit of links for a limit of open files."""
    return max(1, min(MAX_LINKS, files - OTHER_FILES))
