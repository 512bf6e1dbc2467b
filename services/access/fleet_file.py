"""The file that says who belongs to a fleet: names of certificates, and what each is for. Pure.

robots: [r1..r200, lift-3]
roles:
  central: [monitor, worldmodel]
  gpu1: detector
  wall: observer
denied: [r17]
warehouses:
  berlin: {robots: [b1..b40], roles: {gpu-b: detector}}

Names in a warehouse have rights at its routers alone, all others everywhere.
"""

import re
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Final, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from schemas.errors import SchemaError
from schemas.keys import check_name
from services.access.roles import Role
from services.yaml_text import YamlError, line_of, parse

MAX_NAMES: Final = 20_000
"""Robots of a file: each takes about 25 kB of a router's memory, measured with Zenoh 1.10."""

_RANGE: Final = re.compile(r"(?P<stem>.*?)(?P<first>\d+)\.\.(?P=stem)(?P<last>\d+)")


class FleetFileError(Exception):
    """The file cannot be used; the message has its line."""


def expand(text: str) -> Iterator[str]:
    """Yield the names that `r1` or `r1..r200` stands for; with `r001..r200` all have as many digits.

    Raises:
        ValueError: it is no name, and no range of names.
    """
    if ".." not in text:
        yield _checked(text)
        return
    match = _RANGE.fullmatch(text)
    if match is None or int(match["first"]) > int(match["last"]):
        raise ValueError(f"{text[:80]!r}: write a range like r1..r200, which ends in the larger number")
    width = len(match["first"]) if match["first"].startswith("0") else 0
    first, last = int(match["first"]), int(match["last"])
    if last - first >= MAX_NAMES:
        raise ValueError(f"{text[:80]!r}: that is more than {MAX_NAMES} names")
    for number in range(first, last + 1):
        yield _checked(f"{match['stem']}{number:0{width}}")


def _checked(name: str) -> str:
    try:
        check_name("certificate", name)
    except SchemaError as error:
        raise ValueError(str(error)) from error
    return name


def _expands(text: str) -> str:
    for _ in expand(text):
        pass
    return text


def _starts(name: str) -> Iterator[str]:
    """Yield what stands before each dash of a name."""
    return (name[:at] for at, letter in enumerate(name) if letter == "-")


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


Names = Annotated[str, AfterValidator(_expands)]


class Members(BaseModel):
    """Names are those of certificates, and for robots also `--robot`'s."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    robots: list[Names] = Field(default=[], max_length=MAX_NAMES)
    roles: dict[
        Annotated[str, AfterValidator(_checked)], Annotated[list[Role], BeforeValidator(_listed), Field(min_length=1)]
    ] = {}


class FleetFile(Members):
    """The members of the fleet: those of each warehouse, and those of all."""

    denied: list[Names] = Field(default=[], max_length=MAX_NAMES)
    warehouses: dict[Annotated[str, AfterValidator(_checked)], Members] = {}

    def _members(self) -> Sequence[Members]:
        return self, *self.warehouses.values()

    def robot_names(self) -> list[str]:
        """Return the names of the robots."""
        return [name for members in self._members() for text in members.robots for name in expand(text)]

    def names(self) -> list[str]:
        """Return all names, of robots first."""
        return [*self.robot_names(), *(name for members in self._members() for name in members.roles)]

    def at(self, warehouse: str) -> "FleetFile":
        """Return who belongs to a warehouse, as a file of its own.

        Raises:
            ValueError: the file has no such warehouse, or has warehouses and none was named.
        """
        if not warehouse and not self.warehouses:
            return self
        there = self.warehouses.get(warehouse)
        if there is None:
            raise ValueError(f"no warehouse {warehouse!r} in it; there are {', '.join(self.warehouses) or 'none'}")
        robots, roles = [*self.robots, *there.robots], {**self.roles, **there.roles}
        names = {*(name for text in robots for name in expand(text)), *roles}
        return FleetFile(robots=robots, roles=roles, denied=sorted(self.denied_names() & names))

    def denied_names(self) -> frozenset[str]:
        """Return the names that may do nothing any more."""
        return frozenset(name for text in self.denied for name in expand(text))

    @model_validator(mode="after")
    def _has_each_name_once(self) -> Self:
        robots = self.robot_names()
        if len(robots) > MAX_NAMES:
            raise ValueError(f"robots: {len(robots)} names, of at most {MAX_NAMES}")
        once: set[str] = set()
        for name in self.names():
            if name in once:
                raise ValueError(
                    f"{name} is there twice: a certificate is for one robot, or for the roles beside its name"
                )
            once.add(name)
        for name in once:
            if other := next((start for start in _starts(name) if start in once), None):
                raise ValueError(
                    f"{name} begins with another name and a dash, so {other} could speak for it, as workers' names"
                    " begin so; rename one of them"
                )
        if unknown := self.denied_names() - once:
            raise ValueError(f"denied: {min(unknown)} is neither a robot nor has a role")
        return self


def read_fleet(text: str) -> FleetFile:
    """Read a file.

    Raises:
        FleetFileError: it is no such file.
    """
    try:
        content, root = parse(text)
    except YamlError as error:
        raise FleetFileError(str(error)) from error
    try:
        return FleetFile.model_validate({} if content is None else content)
    except ValidationError as error:
        first = error.errors()[0]
        place = list(first["loc"])
        named = ".".join(map(str, place))
        reason = first["msg"].removeprefix("Value error, ")
        raise FleetFileError(f"line {line_of(root, place)}: {f'{named}: ' if named else ''}{reason}") from error
