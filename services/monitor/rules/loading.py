"""Rule files: YAML, validated, and what is wrong said with its line. Pure."""

from pathlib import Path
from typing import Any, Final, Self

import yaml
from pydantic import ValidationError
from yaml.nodes import MappingNode, Node, SequenceNode

from services.monitor.rules.model import RuleBook

MAX_BYTES: Final = 1_000_000


class RuleFileError(Exception):
    """A rule file that cannot be used. line: where, from 1; none if it cannot be read at all."""

    def __init__(self, line: int | None, reason: str, file: Path | None = None) -> None:
        place = [*([] if file is None else [str(file)]), *([] if line is None else [f"line {line}"])]
        super().__init__(": ".join([*place, reason]))
        self.line = line
        self.reason = reason

    def of(self, file: Path) -> Self:
        """Return it with the file's name before the reason."""
        return type(self)(self.line, self.reason, file)


def load_rules(text: str) -> RuleBook:
    """Read a rule file.

    Raises:
        RuleFileError: it is no YAML, says what no rule may say, or names no `rules`, as a file that was emptied does.
    """
    if len(text) > MAX_BYTES:
        raise RuleFileError(1, f"a rule file has at most {MAX_BYTES} characters")
    try:
        root = yaml.compose(text, Loader=_Loader)
        content = yaml.load(text, Loader=_Loader)  # noqa: S506 - a safe loader without aliases
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise RuleFileError(line, error.problem or "not YAML") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise RuleFileError(1, " ".join(str(error).split())[:200] or "not YAML") from error
    if content is None:
        raise RuleFileError(1, f"nothing is in it; {NO_RULES}")
    try:
        book = RuleBook.model_validate(content)
    except ValidationError as error:
        mistakes = error.errors(include_url=False)  # a misspelt name first: it explains why another one is missing
        mistake = next((each for each in mistakes if each["type"] == "extra_forbidden"), mistakes[0])
        place = [part for part in mistake["loc"] if part not in KINDS]
        where = list(mistake.get("ctx", {}).get("place", place))
        raise RuleFileError(_line_of(root, where), _reason(place, mistake)) from error
    if "rules" not in book.model_fields_set:
        raise RuleFileError(1, f"rules is missing; {NO_RULES}")
    return book


NO_RULES: Final = "to have no rules, write `rules: []`"

KINDS: Final = frozenset({"appears", "disappears", "over", "under", "nearer", "silent", "disagree"})
"""What pydantic puts into the place of a mistake to say which kind of rule it took it for."""

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
"""What kinds of pydantic's mistakes are in words of a rule file; its own speak of Python."""


class _Loader(yaml.SafeLoader):
    """Takes no aliases: ten lines of them can stand for gigabytes."""

    def compose_node(self, parent: Node | None, index: int) -> Node | None:
        if self.check_event(yaml.AliasEvent):
            raise yaml.composer.ComposerError(None, None, "aliases are not taken", self.peek_event().start_mark)  # type: ignore[no-untyped-call]
        return super().compose_node(parent, index)

    def construct_object(self, node: Node, deep: bool = False) -> Any:  # noqa: FBT001, FBT002 - PyYAML's
        try:
            return super().construct_object(node, deep)
        except (ValueError, LookupError, AttributeError) as error:  # of a date like 2026-13-01, of `!!bool x`
            reason = f"{str(node.value)[:80]!r} is no {node.tag.rpartition(':')[2]}"
            raise yaml.constructor.ConstructorError(None, None, reason, node.start_mark) from error

    def construct_mapping(self, node: MappingNode, deep: bool = False) -> dict[Any, Any]:  # noqa: FBT001, FBT002 - PyYAML's
        keys = [key.value for key, _ in node.value]
        for place, (key, _) in enumerate(node.value):
            if key.value in keys[:place]:
                raise yaml.constructor.ConstructorError(None, None, f"{key.value!r} is there twice", key.start_mark)
        return super().construct_mapping(node, deep)


def _line_of(node: Node | None, place: list[Any]) -> int:
    """Return the line of what a place names, or of the nearest thing around it that is there."""
    line = 1
    for part in place:
        if isinstance(node, MappingNode):
            found = next(((key, value) for key, value in node.value if key.value == part), None)
            if found is None:
                return line
            line, node = found[0].start_mark.line + 1, found[1]
        elif isinstance(node, SequenceNode) and isinstance(part, int) and part < len(node.value):
            node = node.value[part]
            line = node.start_mark.line + 1
    return line


def _reason(place: list[Any], mistake: Any) -> str:
    name = _name_of(place)
    match mistake["type"]:
        case "missing":
            return f"{name} is missing"
        case "extra_forbidden":
            return f"{place[-1]!r} is not known here"
    reason = WORDS.get(mistake["type"], mistake["msg"].removeprefix("Value error, "))
    return f"{name}: {reason}" if name else reason


def _name_of(place: list[Any]) -> str:
    """Return a place in words: "rule 2: action.name"; which of a list's items is wrong its value or line says."""
    match place:
        case ["rules", int(number), *rest]:
            return ": ".join([f"rule {number + 1}", *([_name_of(rest)] if rest else [])])
    return ".".join(str(part) for part in place if not isinstance(part, int))
