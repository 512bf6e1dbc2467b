from pathlib import Path

import pytest

from services.monitor.alerting.rule_file import RuleFile
from services.monitor.rules.command import run
from services.monitor.rules.loading import MAX_CHARACTERS, RuleFileError
from services.monitor.settings import RulesSettings


async def refused(file: Path, reason: str) -> None:
    """See that a monitor and `rules test` both refuse a file."""
    with pytest.raises(RuleFileError) as by_monitor:
        await RuleFile(file).load()
    with pytest.raises(RuleFileError) as by_command:
        await run(RulesSettings.model_validate({"task": "test", "file": file, "history": "sqlite:////nowhere"}))
    assert (str(by_monitor.value), str(by_command.value)) == (reason, reason)


async def test_of_a_file_that_is_too_long_no_more_is_read_than_says_so(tmp_path: Path) -> None:
    file = tmp_path / "rules.yaml"
    file.write_bytes(b"#" * 3 * MAX_CHARACTERS + b"\xff")  # which could not be read at all
    await refused(file, f"{file}: line 1: a rule file has at most {MAX_CHARACTERS} characters")


async def test_a_bound_is_one_on_characters_whatever_they_take(tmp_path: Path) -> None:
    file = tmp_path / "rules.yaml"
    text = "rules: []  # "
    file.write_text(text + "\N{ROBOT FACE}" * (MAX_CHARACTERS - len(text)), encoding="utf-8")
    rules = RuleFile(file)
    await rules.load()
    assert rules.book.rules == ()


async def test_what_cannot_be_read_is_said_in_words(tmp_path: Path) -> None:
    file = tmp_path / "rules.yaml"
    await refused(file, f"{file}: No such file or directory")
    file.write_bytes(b"rules: \xff")
    await refused(file, f"{file}: 'utf-8' codec can't decode byte 0xff in position 7: invalid start byte")
