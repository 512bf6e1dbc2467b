"""A small share of `python -m tests.fuzz`, and that it sees what it looks for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.fuzz import campaign, message_targets, name_targets, return_targets, wire_targets
from tests.fuzz.target import Target

if TYPE_CHECKING:
    from random import Random

INPUTS = 10_000


def test_every_parser_survives_spoilt_inputs() -> None:
    targets = [*wire_targets.TARGETS, *message_targets.TARGETS, *return_targets.TARGETS, *name_targets.TARGETS]
    report = campaign.run(targets, inputs=INPUTS, seed=7)
    assert not report.findings
    assert report.inputs.total() == INPUTS
    assert report.inputs.keys() == {target.name for target in targets}
    assert 0 < report.refused.total() < INPUTS


def only(feed: object) -> campaign.Report:
    assert callable(feed)
    return campaign.run([Target("bad", [b"good bytes"], feed, (KeyError,))], inputs=300, seed=1)


def test_an_error_that_is_not_documented_is_found_once_with_its_input() -> None:
    def feed(data: bytes, _rng: Random) -> None:
        if data.startswith(b"good"):
            raise KeyError
        raise ValueError(f"{len(data)} bytes")

    report = only(feed)
    (finding,) = report.findings.values()
    assert finding.what.startswith("ValueError: ")
    assert f"ValueError: {len(bytes.fromhex(finding.data))} bytes" == finding.what
    assert 0 < report.refused["bad"] < 300


def test_an_input_that_hangs_is_found() -> None:
    def feed(_data: bytes, _rng: Random) -> None:
        while not hung:
            pass

    hung: list[bool] = []
    report = campaign.run([Target("bad", [b"x"], feed, (KeyError,))], inputs=1, seed=1, max_seconds=0.02)
    (finding,) = report.findings.values()
    assert finding.what.startswith("TooSlowError")


def test_memory_without_measure_is_found() -> None:
    def feed(_data: bytes, _rng: Random) -> None:
        bytes(campaign.MAX_PEAK_BYTES + 1)

    (finding,) = only(feed).findings.values()
    assert finding.what.startswith("memory: ")
