"""Lists of presence tokens, each shown as one token of Zenoh. Pure.

The cost of a token at a router grows with the number of tokens, and a robot has a dozen. So a process that alone speaks
under `fleet/{robot}` shows `fleet/{robot}/@alive/{list}`: the rest of each key, with `:` in the place of `/`, joined by
commas.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Final

from bus.keys import whose

ROOT: Final = "fleet"
"""First chunk of all keys that may be in lists; the second is the robot's name."""

LIST: Final = "@alive"
SLASH: Final = ":"
COMMA: Final = ","

MOST_CHARACTERS: Final = 8_000
"""Longest list: further tokens are in another one. A key of Zenoh has at most 65,535 bytes."""

MOST_READ: Final = 2 * MOST_CHARACTERS
"""Longest list that is read, with its prefix: a longer one is nobody's of ours."""


MOST_OF_ROBOT: Final = 16_384
"""Tokens of one robot that are followed: 64 for each of 256 cameras."""

MOST_FOLLOWED: Final = 400_000
"""Tokens that are followed in all."""


class FollowedTokens:
    """A set of tokens in lists, with so much room for each robot, and in all: a list holds thousands."""

    def __init__(self) -> None:
        self._tokens: set[str] = set()
        self._of = Counter[str]()

    def add(self, key: str) -> bool:
        """Add a token; return whether it is in the set now."""
        if key in self._tokens:
            return True
        owner = whose(key)
        if self.is_full or self._of[owner] >= MOST_OF_ROBOT:
            return False
        self._tokens.add(key)
        self._of[owner] += 1
        return True

    @property
    def is_full(self) -> bool:
        """Whether there is room for no more, whoever's they are."""
        return len(self._tokens) >= MOST_FOLLOWED

    @property
    def has_much_room(self) -> bool:
        """Whether an eighth of what there is room for is free."""
        return len(self._tokens) <= MOST_FOLLOWED * 7 // 8

    def remove(self, key: str) -> None:
        """Remove a token that is in the set."""
        self._tokens.remove(key)
        owner = whose(key)
        self._of[owner] -= 1
        if not self._of[owner]:
            del self._of[owner]

    def __contains__(self, key: str) -> bool:
        return key in self._tokens

    def __iter__(self) -> Iterator[str]:
        return iter(self._tokens)


def can_list(prefix: str, key: str) -> bool:
    """Return whether a token can be in a list of this prefix; of none if it is empty."""
    return bool(prefix) and key.startswith(f"{prefix}/") and not {SLASH, COMMA} & set(key)


def list_keys(prefix: str, keys: Iterable[str]) -> Iterator[str]:
    """Yield the keys of lists that hold these keys, all of which can be listed."""
    names: list[str] = []
    length = 0
    for key in keys:
        name = key.removeprefix(f"{prefix}/").replace("/", SLASH)
        if names and length + len(name) > MOST_CHARACTERS:
            yield f"{prefix}/{LIST}/{COMMA.join(names)}"
            names, length = [], 0
        names.append(name)
        length += len(name) + len(COMMA)
    if names:
        yield f"{prefix}/{LIST}/{COMMA.join(names)}"


def listed_keys(list_key: str) -> list[str]:
    """Return the keys that a list holds."""
    prefix, _, names = list_key.partition(f"/{LIST}/")
    return [f"{prefix}/{name.replace(SLASH, '/')}" for name in names.split(COMMA)]


def lists_of(key_expr: str) -> str:
    """Return the key expression of all lists that may hold a key of an expression, or empty."""
    first, *rest = key_expr.split("/")
    if first == "**":
        return f"{ROOT}/*/{LIST}/*"
    if first not in {ROOT, "*"} or not rest:
        return ""
    return f"{ROOT}/{'*' if rest[0] == '**' else rest[0]}/{LIST}/*"
