import pytest

from benchmarks.progress import note_step


def test_a_stage_is_shown_now_and_then_and_at_its_end(capsys: pytest.CaptureFixture[str]) -> None:
    for done in range(1, 6):
        note_step("look", done, 5, every=2)
    assert capsys.readouterr().err.splitlines() == ["look 2/5", "look 4/5", "look 5/5"]
