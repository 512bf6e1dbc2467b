import pytest

from benchmarks.guide.__main__ import main


@pytest.mark.parametrize("option", ["--repeats", "--slow", "--instants"])
def test_counts_are_at_least_one(option: str, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main([option, "0"])
    assert left.value.code == 2
    assert option in capfd.readouterr().err
