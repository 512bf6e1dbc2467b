"""Loads and validates YAML rule files; errors name the line. Pure."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, Self

from pydantic import ValidationError

from services.monitor.rules.model import RuleBook
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

KINDS: Final = frozenset({"appears", "disappears", "over", "under", "nearer", "silent", "disagree"})
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


@contextmanager
def reading() -> Iterator[None]:
    """Turn errors of reading a file into RuleFileError."""
    try:
        yield
    except (OSError, UnicodeDecodeError) as error:
        raise RuleFileError(None, getattr(error, "strerror", None) or str(error)) from error


def text_of(path: Path) -> str:
    """Return the text of a rule file; of one that is too long, enough for `load_rules` to refuse it.

    Raises:
        RuleFileError: it cannot be read.
    """
    with reading(), path.open(encoding="utf-8") as file:
        return file.read(MAX_CHARACTERS + 1)
