from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from services.monitor.history.errors import HistoryError
from services.monitor.history.intervals import Interval
from services.monitor.history.store import Store
from services.monitor.rules.loading import RuleFileError
from services.monitor.rules.process import run
from services.monitor.rules.replay import caveats, replay
from services.monitor.rules.settings import RulesSettings
from tests.services.monitor.history.test_store import interval
from tests.services.monitor.inventory.seeing import S
from tests.services.monitor.rules.ruling import book


def count(since_s: int, until_s: int, number: int, name: str = "box", **more: Any) -> Interval:
    return replace(interval(since_s, until_s, name=name), **{"count": number, "closest_m": None, **more})


HISTORY = [
    count(1, 10, 1),
    count(10, 20, 3),
    count(20, 30, 1),
    count(40, 50, 1, closest_m=1.25),
    count(60, 70, 1, open=True, closest_m=3.0),
]


def tried(rule: dict[str, Any]) -> list[tuple[int, str]]:
    return [(effect.alert.changed_ns // S, effect.alert.state.value) for effect in replay(book(rule), HISTORY)]


@pytest.mark.parametrize(
    ("rule", "alerts"),
    [
        ({"when": "appears"}, [(40, "raised"), (50, "resolved"), (60, "raised")]),
        ({"when": "disappears"}, [(30, "raised"), (40, "resolved"), (50, "raised"), (60, "resolved")]),
        ({"when": "over", "count": 2}, [(10, "raised"), (20, "resolved")]),
        ({"when": "over", "count": 2, "for_s": 9}, [(19, "raised"), (20, "resolved")]),
        ({"when": "over", "count": 2, "for_s": 11}, []),
        (
            {"when": "under", "count": 1, "for_s": 9},
            [(39, "raised"), (40, "resolved"), (59, "raised"), (60, "resolved")],
        ),
        ({"when": "under", "count": 1, "for_s": 10}, []),
        ({"when": "nearer", "than_m": 1.5, "for_s": 5}, [(45, "raised"), (50, "resolved")]),
        ({"when": "over", "count": 0, "robots": ["r2"]}, []),
    ],
)
def test_history_raises_what_it_would_have_raised(rule: dict[str, Any], alerts: list[tuple[int, str]]) -> None:
    assert tried({**rule, "class": "box"}) == alerts


def test_what_cannot_be_tried_is_said() -> None:
    rules = book({"when": "silent"}, {"when": "disagree"}, {"when": "nearer", "class": "box", "than_m": 1})
    assert [note.split(": ")[1][:12] for note in caveats(rules)] == ["is not tried", "is not tried", "is tried wit"]
    assert list(replay(rules, [])) == []


async def test_the_command_prints_what_would_have_been_raised(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = f"sqlite:///{tmp_path}/history.db"
    store = await Store.open(url)
    try:
        await store.write(HISTORY, [], 70 * S)
    finally:
        await store.close()
    file = tmp_path / "rules.yaml"
    rules = "rules: [{name: many, when: over, class: box, count: 2}, {name: gone, when: silent}]"
    file.write_text(rules, encoding="utf-8")
    await run(RulesSettings(task="test", file=file, history=url))
    raised, resolved, summary, note = capsys.readouterr().out.splitlines()
    assert raised.endswith("raised warning many: 3 box in view of r1/front, over 2")
    assert "resolved warning many" in resolved
    assert summary == "2 rules, 5 intervals, 1 alerts"
    assert note.startswith("gone: is not tried")
    file.write_text(rules.replace("count: 2", "count: many"), encoding="utf-8")
    with pytest.raises(RuleFileError, match=r"rules\.yaml: line 1: rules\.0\.count"):
        await run(RulesSettings(task="test", file=file, history=url))
    with pytest.raises(RuleFileError, match=r"none\.yaml: No such file"):
        await run(RulesSettings(task="test", file=tmp_path / "none.yaml", history=url))
    file.write_text(rules, encoding="utf-8")
    with pytest.raises(HistoryError, match="does not exist"):
        await run(RulesSettings(task="test", file=file, history=f"sqlite:///{tmp_path}/none.db"))
