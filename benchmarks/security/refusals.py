"""Runs the tests of access rules on real routers and counts the forbidden attempts, and those that were refused."""

import contextlib
import io
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import pytest

ROOT: Final = Path(__file__).parents[2]
FILES: Final = (
    "tests/services/access/test_sending.py",
    "tests/services/access/test_hearing.py",
    "tests/services/access/test_certificates_misused.py",
    "tests/services/access/test_rules.py::test_a_certificate_of_another_authority_opens_no_link",
    "tests/services/access/test_rules.py::test_a_link_ends_with_its_certificate",
    "tests/services/access/test_enrolment.py::test_of_two_machines_with_one_token_one_enrols",
    "tests/services/access/test_enrolment.py::test_a_token_that_lets_nobody_in",
    "tests/services/access/test_enrolment.py::test_renewal_is_refused",
    "tests/bus/test_tls.py",
)
PREFIX: Final = "test_"
FAIR: Final = "test_old_certificates_and_renewed_ones_fit_each_other"


class Refusals:
    """A plugin of pytest: cases are what rules forbid, by test; refused are those that came to nothing.

    One whose preparations failed was not refused.
    """

    def __init__(self) -> None:
        self.cases = Counter[str]()
        self.refused = Counter[str]()
        self.allowed = 0
        self.failed: list[str] = []

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_makereport(self, item: Any) -> Any:
        """Count the outcome of a test."""
        outcome = yield
        report = outcome.get_result()
        if not report.passed:
            self.failed.append(f"{item.nodeid} ({report.when})")
        if report.when == "teardown" or (report.when == "setup" and report.passed):
            return
        forbidden = not getattr(item, "callspec", None) or not item.callspec.params.get("allowed", False)
        group = item.originalname.removeprefix(PREFIX)
        if forbidden and item.originalname != FAIR:
            self.cases[group] += 1
            self.refused[group] += report.passed
        else:
            self.allowed += report.passed

    def figures(self) -> Mapping[str, Any]:
        """Return the counts."""
        return {
            "cases": self.cases.total(),
            "refused": self.refused.total(),
            "allowed_as_meant": self.allowed,
            "groups": {
                name: {"cases": count, "refused": self.refused[name]} for name, count in sorted(self.cases.items())
            },
            "not_passed": len(self.failed),
            "not_passed_tests": self.failed,
        }


def count_refusals() -> Mapping[str, Any]:
    """Run the tests; return the counts."""
    counted = Refusals()
    options = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main([*options, *(str(ROOT / file) for file in FILES)], [counted])
    return counted.figures()
