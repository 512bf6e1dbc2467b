"""Commands that README and docs name exist, with the options that they are given there."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from pydantic import BaseModel

from services.toolbox.command import Command
from services.toolbox.commands import COMMANDS
from services.toolbox.settings import names_of

ROOT: Final = Path(__file__).parents[3]
PAGES: Final = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
LINE: Final = re.compile(r"^    (?:.*/)?(fleetsight [a-z].*)$", re.MULTILINE)
INLINE: Final = re.compile(r"`(fleetsight [a-z][^`]*)`")


def commands(page: Path) -> Iterator[str]:
    """Yield the command lines of a page, from code blocks and from its text."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    yield from LINE.findall(text)
    yield from (" ".join(found.split()) for found in INLINE.findall(text))


def options(command: Command) -> set[str]:
    """Return the names of a command's options, without dashes."""
    model: type[BaseModel] = command.load_settings()
    names = {name.replace("_", "-") for name in names_of(model)} | {"help"}
    return names | {f"no-{name}" for name in names}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_commands_of_a_page_exist_with_their_options(page: Path) -> None:
    known = {command.name: options(command) for command in COMMANDS}
    unknown = []
    for line in commands(page):
        _, name, *words = shlex.split(line, comments=True)
        named = {word[2:].partition("=")[0] for word in words if word.startswith("--")}
        if name not in known or named - known[name]:
            unknown.append(line)
    assert unknown == []


def test_commands_are_found_in_blocks_and_in_sentences() -> None:
    found = list(commands(ROOT / "docs" / "backup.md")) + list(commands(ROOT / "docs" / "bags.md"))
    assert "fleetsight gateway --robot r1" in found
    assert "fleetsight doctor --robot r1" in found
    assert "fleetsight history export" in found
