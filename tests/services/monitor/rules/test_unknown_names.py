from typing import Any

import pytest

from services.monitor.rules.loading import Classes, remarks
from tests.services.monitor.rules.ruling import book

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
