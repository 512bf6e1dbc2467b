from pathlib import Path

import pytest

from services.training.files import effort_so_far, metered


def interrupted(record: Path) -> None:
    with metered(record):
        sum(range(300_000))
        raise KeyboardInterrupt


def test_effort_adds_up_also_over_interruptions(tmp_path: Path) -> None:
    record = tmp_path / "effort.json"
    assert effort_so_far(record).cpu_s == 0
    with metered(record):
        sum(range(300_000))
    first = effort_so_far(record)
    with pytest.raises(KeyboardInterrupt):
        interrupted(record)
    second = effort_so_far(record)
    assert 0 < first.cpu_s < second.cpu_s
    assert 0 < first.wall_s < second.wall_s
