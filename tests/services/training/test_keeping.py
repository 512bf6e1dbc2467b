from pathlib import Path

import msgspec
import pytest

from services.training.files import TrainingError, kept


class Squared(msgspec.Struct, frozen=True):
    """What is made of a seed."""

    value: int


class Maker:
    """Squares seeds and notes which."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def __call__(self, seed: int) -> Squared:
        self.asked.append(seed)
        return Squared(seed**2)


def made(folder: Path, make: Maker, *seeds: int) -> tuple[list[int], list[tuple[str, int, int]]]:
    """Return the values for the seeds and what was reported."""
    reports: list[tuple[str, int, int]] = []
    found = kept(folder, seeds, make, Squared, workers=1, report=lambda *report: reports.append(report))
    return [each.value for each in found], reports


def test_what_is_kept_is_not_made_again(tmp_path: Path) -> None:
    make, folder = Maker(), tmp_path / "new"
    assert made(folder, make, 3, 2) == ([9, 4], [("render scenes", done, 2) for done in (0, 1, 2)])
    assert made(folder, make, 2, 5, 3) == ([4, 25, 9], [("render scenes", done, 3) for done in (2, 3)])
    assert make.asked == [3, 2, 5]


def test_what_was_interrupted_is_made_again(tmp_path: Path) -> None:
    (tmp_path / "000000003.part").write_bytes(b"half")
    assert made(tmp_path, Maker(), 3)[0] == [9]
    assert [file.name for file in tmp_path.iterdir()] == ["000000003.msgpack"]


@pytest.mark.parametrize("content", [b"", b"\xc1", msgspec.msgpack.encode({"value": "four"})])
def test_a_damaged_file_is_named(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "000000002.msgpack").write_bytes(content)
    with pytest.raises(TrainingError, match=r"000000002\.msgpack: damaged .*; remove it"):
        made(tmp_path, Maker(), 2)
