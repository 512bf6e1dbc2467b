import pytest

from benchmarks.monitor.__main__ import main


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--robots", "996"], "--robots 996: not a multiple of 4, 1000 or more"),
        (["--robots", "5001"], "--robots 5001: not a multiple of 4"),
        (["--sessions", "0"], "--sessions 0: not a multiple of 4"),
    ],
)
def test_a_fleet_that_its_processes_cannot_share_evenly_is_refused(
    options: list[str], why: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["benchmarks.monitor", *options])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert why in capsys.readouterr().err
