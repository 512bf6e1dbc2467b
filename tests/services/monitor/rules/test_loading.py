"""Rule files: what is loaded, refused and remarked upon."""

from pathlib import Path
from typing import Any

import pytest

from schemas.alerts import Severity
from services.monitor.rules.command import run
from services.monitor.rules.loading import MAX_CHARACTERS, Classes, RuleFileError, load_rules, remarks
from services.monitor.rules.model import NearerRule, SilentRule
from services.monitor.rules.rule_file import RuleFile
from services.monitor.settings import RulesSettings
from tests.services.monitor.rules.ruling import book

GOOD = """\
timezone: Europe/Berlin
webhooks:
  ops: {url: "https://ops.example/hook", secret: "a long secret"}
rules:
  - name: too near
    when: nearer
    class: forklift
    than_m: 2
    for_s: 1.5
    robots: [r1, "dock*"]
    between: ["22:00", "06:00"]
    days: [mon, tue]
    severity: critical
    cooldown_s: 60
    escalate_after_s: 300
    webhooks: [ops]
    escalate_webhooks: [ops]
    action: {name: stop, payload: "{class} at {camera}"}
  - name: lost
    when: silent
    for_s: 30
"""


def test_a_rule_file() -> None:
    book = load_rules(GOOD)
    near, lost = book.rules
    assert isinstance(near, NearerRule)
    assert (near.of, near.than_m, near.for_s, near.severity) == ("forklift", 2.0, 1.5, Severity.CRITICAL)
    assert near.applies_to("dock7", "front")
    assert not near.applies_to("r10", "front")
    assert isinstance(lost, SilentRule)
    assert not lost.of_cameras


def test_a_file_says_that_there_are_no_rules() -> None:
    assert load_rules("rules: []").rules == load_rules("# none yet\nrules: []\n").rules == ()


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        (changed("than_m: 2", "than_m: -2"), 8, "rule 1: than_m: Input should be greater than 0"),
        (changed("    than_m: 2\n", ""), 5, "rule 1: than_m is missing"),
        (changed("than_m: 2", "than: 2"), 8, "'than' is not a known key here"),
        (changed("for_s: 30", "fors: 30"), 21, "'fors' is not a known key here"),
        (changed("when: silent", "when: asleep"), 19, "`when` is one of"),
        (changed("    when: silent\n", ""), 19, "rule 2: `when` is missing"),
        (changed("severity: critical", "severity: panic"), 13, "rule 1: severity: "),
        (changed("[mon, tue]", "[mon, someday]"), 12, "rule 1: days: Input should be 'mon'"),
        (changed('["22:00", "06:00"]', "[22:00, 06:00]"), 11, "write times in quotes"),
        (changed('["22:00", "06:00"]', "[22.00, 06.00]"), 11, "write times in quotes"),
        (changed('["22:00", "06:00"]', '["22:00Z", "06:00Z"]'), 11, "without a time zone"),
        (changed('["22:00", "06:00"]', '["06:00", "06:00"]'), 11, "starts and ends at the same time"),
        (changed("cooldown_s: 60", "cooldown_s: !!bool 60"), 14, "'60' is no bool"),
        (changed("cooldown_s: 60", "cooldown_s: 2026-13-01"), 14, "'2026-13-01' is no timestamp"),
        (changed("    webhooks: [ops]", "    webhooks: [opps]"), 16, "an unknown webhook 'opps'"),
        (changed("    webhooks: [ops]", "    webhooks: ops"), 16, "rule 1: webhooks: write it as a list, like [a, b]"),
        (changed("escalate_webhooks: [ops]", "escalate_webhooks: [boss]"), 17, "an unknown webhook 'boss'"),
        ("rules:\n  - silent\n", 2, "rule 1: write it as a mapping, like {a: b}"),
        (changed('{name: stop, payload: "{class} at {camera}"}', "stop"), 18, "rule 1: action: write it as a mapping"),
        ("webhooks: [ops]\n", 1, "webhooks: write it as a mapping, like {a: b}"),
        (changed('"06:00"', '"6:00"'), 11, "rule 1: between: write times like '09:00', up to '23:59'"),
        (changed('"06:00"', '"24:00"'), 11, "rule 1: between: write times like '09:00', up to '23:59'"),
        (changed("name: lost", "name: too near"), 19, "two rules are called 'too near'"),
        (changed("Europe/Berlin", "Mars/Olympus"), 1, "no time zone 'Mars/Olympus'"),
        (changed("name: stop", "name: stop now"), 18, "rule 1: action.name: "),
        (changed("    when: silent", "    name: again\n    when: silent"), 20, "'name' is given twice"),
        ("", 1, "the file is empty; to have no rules, write `rules: []`"),
        ("# none yet\n", 1, "the file is empty; to have no rules, write `rules: []`"),
        ("---\n...\n", 1, "the file is empty"),
        ("timezone: Europe/Berlin\n", 1, "rules is missing; to have no rules, write `rules: []`"),
        ("rules:\n", 1, "rules: write it as a list"),
        ("rules: [", 1, "expected the node content"),
        ("rules:\n  - &a {name: x}\n  - *a\n", 3, "aliases are not taken"),
        ("- 1\n- 2\n", 1, "write it as a mapping, like {a: b}"),
        ("a: !!python/object:os.system {}", 1, "could not determine a constructor"),
        ("x" * (MAX_CHARACTERS + 1), 1, "at most"),
        ("\0", 1, "special characters"),
        ("[" * 10_000, 1, ""),
    ],
)
def test_a_mistake_is_shown_with_its_line(text: str, line: int, reason: str) -> None:
    with pytest.raises(RuleFileError) as raised:
        load_rules(text)
    assert reason in raised.value.reason
    assert raised.value.line == line
    assert "\n" not in str(raised.value)


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


BOXES = {"box", "pallet"}
MISSPELT = {"name": "near", "when": "nearer", "class": "palet", "than_m": 2}
DISAGREE = {"name": "odd", "when": "disagree", "class": "person"}


def said(
    rule: dict[str, Any],
    detectors: Classes = (BOXES,),
    opinions: Classes = (),
    seen: tuple[str, ...] = (),
    robots: tuple[str, ...] = (),
) -> list[str]:
    return list(remarks(book(rule), detectors, opinions, lambda name: name in seen, set(robots)))


def test_a_class_that_no_detector_reports_is_remarked() -> None:
    assert said(MISSPELT) == ["rule 'near': no detector reports 'palet'"]
    assert said({**MISSPELT, "class": "pallet"}) == []
    assert said(MISSPELT, detectors=[BOXES, {"palet"}]) == []


@pytest.mark.parametrize(
    "known",
    [{"detectors": ()}, {"detectors": (BOXES, ())}, {"seen": ("palet",)}],
    ids=["no detector is there", "one does not say", "somebody else reports it"],
)
def test_what_is_not_known_is_not_remarked(known: dict[str, Any]) -> None:
    assert said(MISSPELT, **known) == []


def test_a_second_opinion_counts_for_rules_about_disagreement_alone() -> None:
    assert said(DISAGREE) == ["rule 'odd': no detector reports 'person'"]
    assert said(DISAGREE, opinions=[{"person"}]) == []
    assert said({**MISSPELT, "class": "person"}, opinions=[{"person"}]) == ["rule 'near': no detector reports 'person'"]
    assert said({"when": "disagree"}) == []


def test_a_pattern_that_fits_no_robot_is_remarked_once_there_are_robots() -> None:
    lost = {"name": "lost", "when": "silent", "robots": ["dokc*", "r1"]}
    assert said(lost) == []
    assert said(lost, robots=("dock1", "r1")) == ["rule 'lost': no robot is called 'dokc*'"]
    assert said(lost, robots=("dokc1",)) == ["rule 'lost': no robot is called 'r1'"]


def test_what_an_actions_payload_has_in_braces_and_is_not_filled_in_is_remarked() -> None:
    def of(payload: str) -> list[str]:
        return said({"when": "silent", "name": "lost", "action": {"name": "stop", "payload": payload}})

    told = "in its payload is unknown and sent as it is: only {robot}, {camera} and {class} are filled in"
    assert of("{class} at {robot}/{camera} {nope}") == [f"rule 'lost': '{{nope}}' {told}"]
    assert of("{Robot} { camera } {nope} {nope}") == [
        f"rule 'lost': '{each}' {told}" for each in ("{Robot}", "{ camera }", "{nope}")
    ]
    assert of('{"robot": "{robot}", "stop": {"after_s": 2}, "empty": {}, "at": [{"x": {}}]}') == []
    assert of("") == said({"when": "silent", "name": "lost"}) == []
