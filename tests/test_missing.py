from pathlib import Path

import pytest

from tests.missing import require_debian

HERE = Path(__file__)
GONE = HERE / "nothing"


@pytest.mark.parametrize(("ci", "outcome"), [("", pytest.skip.Exception), ("true", pytest.fail.Exception)])
def test_what_is_missing_is_skipped_but_not_in_ci(
    ci: str, outcome: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CI", ci)
    require_debian("Python", [HERE], how="")
    with pytest.raises(outcome, match=r"Python is missing \(.*nothing\); make installs it"):
        require_debian("Python", [HERE, GONE], how="make installs it")
