"""Unknown names in rules: classes, placeholders and robots that are misspelt, or not present yet. Pure."""

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from collections.abc import Set as AbstractSet
from fnmatch import fnmatchcase
from typing import Final

from services.monitor.rules.model import PLACEHOLDERS, AnyRule, DisagreeRule, RuleBook, SilentRule

Classes = Sequence[Collection[str]]
"""The classes that each worker reports; empty for one that does not declare them."""

WILDCARDS: Final = frozenset("*?[")
NAMED: Final = re.compile(r"\{\s*[^\W\d]\w*\s*\}")
"""Matches a possible placeholder; names in JSON's braces are quoted, so that they do not match."""

MAX_SHOWN: Final = 64


def remarks(
    book: RuleBook, detectors: Classes, opinions: Classes, seen: Callable[[str], bool], robots: AbstractSet[str]
) -> Iterator[str]:
    """Yield a line for each unknown class, placeholder of a payload and pattern of robots.

    detectors, opinions: the workers that are there. seen: whether a class was ever in view. robots: those ever heard
    of. Of classes it says nothing while no detector is there or one does not say what it reports.
    """
    for rule in book.rules:
        workers = [*detectors, *(opinions if isinstance(rule, DisagreeRule) else ())]
        name = _class_of(rule)
        known = not name or not detectors or not all(workers) or any(name in classes for classes in workers)
        if not known and not seen(name):
            yield f"rule {rule.name!r}: no detector reports {name!r}"
        for placeholder in _not_filled_in(rule):
            filled_in = "only {}, {} and {} are filled in".format(*PLACEHOLDERS)
            yield f"rule {rule.name!r}: {placeholder!r} in its payload is unknown and sent as it is: {filled_in}"
        for pattern in rule.robots if robots else ():
            if not _fits_any(pattern, robots):
                yield f"rule {rule.name!r}: no robot is called {pattern!r}"


def _not_filled_in(rule: AnyRule) -> list[str]:
    payload = "" if rule.action is None else rule.action.payload
    return [each[:MAX_SHOWN] for each in dict.fromkeys(NAMED.findall(payload)) if each not in PLACEHOLDERS]


def _fits_any(pattern: str, robots: AbstractSet[str]) -> bool:
    """Whether a name is there, or a pattern fits one: only patterns are compared with all of thousands."""
    return pattern in robots or (
        not WILDCARDS.isdisjoint(pattern) and any(fnmatchcase(robot, pattern) for robot in robots)
    )


def _class_of(rule: AnyRule) -> str:
    return "" if isinstance(rule, SilentRule) else rule.of
