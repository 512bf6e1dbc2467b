import asyncio
from pathlib import Path

import pytest

from services.monitor.rules import rule_file as module
from services.monitor.rules.loading import RuleFileError
from services.monitor.rules.rule_file import RuleFile
from tests.waiting import until

ONE = "rules: [{name: a, when: silent}]\n"


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


async def test_a_file_that_cannot_be_used_at_the_start_is_named(tmp_path: Path) -> None:
    for name, text, reason in (
        ("none", None, "No such file or directory"),
        ("bad", "rules: 1\n", "line 1: rules"),
        ("empty", "", "line 1: the file is empty"),
    ):
        path = tmp_path / f"{name}.yaml"
        if text is not None:
            written(path, text)
        with pytest.raises(RuleFileError) as caught:
            await RuleFile(path).load()
        assert str(caught.value).startswith(f"{path}: {reason}")


async def test_a_mistake_leaves_the_rules_as_they_were_and_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LOOK_S", 0.01)
    path = written(tmp_path / "rules.yaml", ONE)
    file = RuleFile(path)
    await file.load()
    assert [rule.name for rule in file.book.rules] == ["a"]
    watching = asyncio.create_task(file.watch())
    try:
        written(path, "rules:\n  - {name: b, when: asleep}\n")
        await until(lambda: "line 2" in file.problem)
        assert file.problem.endswith("the rules stay as they were")
        assert [rule.name for rule in file.book.rules] == ["a"]
        path.unlink()
        await until(lambda: "No such file" in file.problem)
        written(path, ONE.replace("a,", "bcd,"))
        await until(lambda: not file.problem)
        assert [rule.name for rule in file.book.rules] == ["bcd"]
    finally:
        watching.cancel()
        await asyncio.wait([watching])


async def test_a_file_that_is_being_written_puts_no_rules_out_of_force(tmp_path: Path) -> None:
    path = written(tmp_path / "rules.yaml", ONE)
    file = RuleFile(path)
    await file.load()
    names: list[list[str]] = []
    for text in ("", "rules:\n", ONE.replace("}]", "}, {name: b, when: silent}]")):
        written(path, text)
        await file.look(path)
        names.append([rule.name for rule in file.book.rules])
    assert (names, file.problem) == ([["a"]] * 3, "")
    await file.look(path)
    assert [rule.name for rule in file.book.rules] == ["a", "b"]


@pytest.mark.parametrize("text", ["", "# - {name: a, when: silent}\n"])
async def test_a_file_that_was_emptied_puts_no_rules_out_of_force(tmp_path: Path, text: str) -> None:
    path = written(tmp_path / "rules.yaml", ONE)
    file = RuleFile(path)
    await file.load()
    written(path, text)
    await file.look(path)
    await file.look(path)
    assert [rule.name for rule in file.book.rules] == ["a"]
    assert file.problem.startswith(
        f"{path}: line 1: the file is empty; to have no rules, write `rules: []`; the rules stay"
    )
    written(path, "rules: []\n")
    await file.look(path)
    await file.look(path)
    assert (file.book.rules, file.problem) == ((), "")


async def test_a_file_that_is_back_as_it_was_is_no_problem_any_more(tmp_path: Path) -> None:
    path = written(tmp_path / "rules.yaml", ONE)
    file = RuleFile(path)
    await file.load()
    path.rename(tmp_path / "away")
    await file.look(path)
    assert file.problem
    (tmp_path / "away").rename(path)
    await file.look(path)
    await file.look(path)
    assert not file.problem


async def test_a_monitor_does_not_begin_with_a_mistake(tmp_path: Path) -> None:
    for path in (written(tmp_path / "rules.yaml", "rules: 1\n"), tmp_path / "missing.yaml"):
        with pytest.raises(RuleFileError):
            await RuleFile(path).load()


async def test_no_file_is_no_rules() -> None:
    file = RuleFile(None)
    await file.load()
    await file.watch()
    assert (file.book.rules, file.problem) == ((), "")
