import pytest

from tests.deploy.support import machine


@pytest.mark.parametrize(("ci", "outcome"), [("", pytest.skip.Exception), ("true", pytest.fail.Exception)])
def test_where_no_system_can_be_made_its_tests_are_skipped_but_not_in_ci(
    ci: str, outcome: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CI", ci)
    monkeypatch.setattr(machine, "TOOLS", ())
    monkeypatch.setattr(machine, "DEBIANS_PYTHON", (3, 2))
    with pytest.raises(outcome, match=r"run the tests as root|Debian's Python 3\.2, not with 3\."):
        machine.require_containers()
