"""Loads YAML rule files: errors name the line, remarks name what is probably misspelt. Pure."""

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from collections.abc import Set as AbstractSet
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final, Self

from pydantic import ValidationError

from services.monitor.rules.model import PLACEHOLDERS, AnyRule, DisagreeRule, RuleBook, SilentRule
from services.yaml_text import YamlError, line_of, parse

MAX_CHARACTERS: Final = 1_000_000


class RuleFileError(Exception):
    """A rule file is unusable. line: from 1; None if the file cannot be read at all."""

    def __init__(self, line: int | None, reason: str, file: Path | None = None) -> None:
        place = [*([] if file is None else [str(file)]), *([] if line is None else [f"line {line}"])]
        super().__init__(": ".join([*place, reason]))
        self.line = line
        self.reason = reason

    def of(self, file: Path) -> Self:
        """Return the error with the file's name before the reason."""
        return type(self)(self.line, self.reason, file)


def load_rules(text: str) -> RuleBook:
    """Parse a rule file.

    Raises:
        RuleFileError: it is no YAML, says what no rule may say, or names no `rules`, as a file that was emptied does.
    """
    if len(text) > MAX_CHARACTERS:
        raise RuleFileError(1, f"a rule file has at most {MAX_CHARACTERS} characters")
    try:
        content, root = parse(text)
    except YamlError as error:
        raise RuleFileError(error.line, error.reason) from error
    if content is None:
        raise RuleFileError(1, f"the file is empty; {NO_RULES}")
    try:
        book = RuleBook.model_validate(content)
    except ValidationError as error:
        mistakes = error.errors(include_url=False)  # misspelt keys first: they explain missing ones
        mistake = next((each for each in mistakes if each["type"] == "extra_forbidden"), mistakes[0])
        place = [part for part in mistake["loc"] if part not in KINDS]
        where = list(mistake.get("ctx", {}).get("place", place))
        raise RuleFileError(line_of(root, where), _reason(place, mistake)) from error
    if "rules" not in book.model_fields_set:
        raise RuleFileError(1, f"rules is missing; {NO_RULES}")
    return book


NO_RULES: Final = "to have no rules, write `rules: []`"

KINDS: Final = frozenset(
    {"appears", "disappears", "over", "under", "nearer", "silent", "disagree"}
    | {"zone_over", "zone_under", "enters", "leaves", "moved", "missing", "near_robot", "unseen"}
)
"""Rule kinds, which pydantic adds to the location of an error."""

MAPPING: Final = "write it as a mapping, like {a: b}"
WORDS: Final = {
    "union_tag_not_found": f"`when` is missing; it is one of {', '.join(sorted(KINDS))}",
    "union_tag_invalid": f"`when` is one of {', '.join(sorted(KINDS))}",
    "tuple_type": "write it as a list, like [a, b]",
    "model_type": MAPPING,
    "model_attributes_type": MAPPING,
    "dict_type": MAPPING,
    "time_parsing": "write times like '09:00', up to '23:59'",
}
"""Messages by pydantic error type; pydantic's own speak of Python."""


def _reason(place: list[Any], mistake: Any) -> str:
    name = _name_of(place)
    match mistake["type"]:
        case "missing":
            return f"{name} is missing"
        case "extra_forbidden":
            return f"{place[-1]!r} is not a known key here"
    reason = WORDS.get(mistake["type"], mistake["msg"].removeprefix("Value error, "))
    return f"{name}: {reason}" if name else reason


def _name_of(place: list[Any]) -> str:
    """Return a place in words: "rule 2: action.name"; which of a list's items is wrong its value or line says."""
    match place:
        case ["rules", int(number), *rest]:
            return ": ".join([f"rule {number + 1}", *([_name_of(rest)] if rest else [])])
    return ".".join(str(part) for part in place if not isinstance(part, int))


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
