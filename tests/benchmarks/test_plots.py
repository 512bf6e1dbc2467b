import json
from pathlib import Path

import pytest

from benchmarks.plots import main
from tests.benchmarks.plotting.kept import kept

ROOT = Path(__file__).parents[2]


def drawn(results: Path, plots: Path) -> int:
    with pytest.raises(SystemExit) as left:
        main(["--results", str(results), "--plots", str(plots)])
    assert isinstance(left.value.code, int)
    return left.value.code


def test_what_was_measured_is_drawn_and_the_rest_named(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "gateway.json").write_text(json.dumps(kept("gateway")))
    assert drawn(tmp_path, tmp_path / "new" / "plots") == 0
    assert [path.name for path in (tmp_path / "new" / "plots").iterdir()] == ["gateway.svg"]
    assert f"scaling: {tmp_path / 'scaling.json'} is not there" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("text", "reason"), [('{"benchmark": "gateway", "figures": {}}', "no such figure"), ("{", "Expecting")]
)
def test_what_cannot_be_drawn_is_named_and_stays(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], text: str, reason: str
) -> None:
    (tmp_path / "gateway.json").write_text(text)
    (tmp_path / "gateway.svg").write_text("old")
    assert drawn(tmp_path, tmp_path) == 1
    line = capfd.readouterr().err.splitlines()[-1]
    assert line.startswith(f"python -m benchmarks.plots: {tmp_path / 'gateway.json'}: ")
    assert reason in line
    assert (tmp_path / "gateway.svg").read_text() == "old"


def test_the_pictures_in_docs_are_those_of_the_kept_results(tmp_path: Path) -> None:
    assert drawn(ROOT / "benchmarks" / "results", tmp_path) == 0
    expected = {path.name: path.read_bytes() for path in (ROOT / "docs" / "plots").glob("*.svg")}
    assert {path.name: path.read_bytes() for path in tmp_path.glob("*.svg")} == expected
