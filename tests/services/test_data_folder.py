"""Whose labels the pictures of a folder have."""

from pathlib import Path

import pytest

from services.data_folder import DatasetError, Origin, Origins, images_in, labels_of, names_in, write_names

IMAGES = ["train/images/a.jpg", "train/images/b.PNG", "val/images/c.jpeg", "val/images/d.jpg"]


def folder(path: Path) -> Path:
    for name in [*IMAGES, "train/images/a.txt", "train/images/half.part"]:
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).touch()
    for name in IMAGES[:3]:
        file = labels_of(path / name)
        file.parent.mkdir(exist_ok=True)
        file.touch()
    return path


def test_images_are_known_by_their_suffix(tmp_path: Path) -> None:
    assert [each.name for each in images_in(folder(tmp_path), "train")] == ["a.jpg", "b.PNG"]
    assert [each.name for each in images_in(tmp_path, "val", "test")] == ["c.jpeg", "d.jpg"]


def test_origins_by_the_records(tmp_path: Path) -> None:
    found = Origins(folder(tmp_path))
    assert {found.of(tmp_path / name) for name in IMAGES[:3]} == {Origin.UNKNOWN}
    collected = '{"file": "train/images/a.jpg", "drafts_by": "m"}\n{"file": "train/images/b.PNG"}\n'
    (tmp_path / "collected.jsonl").write_text(collected + '{"file": "val/images/c.jpeg", "drafts_by": "m"}\n')
    (tmp_path / "labelled.jsonl").write_text('{"file": "val/images/c.jpeg"}\n{"file": "val/images/d.jpg"}\n{"file')
    found = Origins(tmp_path)
    origins = [found.of(tmp_path / name) for name in IMAGES]
    assert origins == [Origin.DRAFT, Origin.UNKNOWN, Origin.PERSON, Origin.NONE]
    assert found.drafts_by == {"train/images/a.jpg": "m", "val/images/c.jpeg": "m"}


def test_names_are_written_and_read(tmp_path: Path) -> None:
    assert names_in(tmp_path / "data.yaml") == []
    write_names(tmp_path / "data.yaml", ["a", "ü"], path="/x")
    assert (tmp_path / "data.yaml").read_text(encoding="utf-8") == "path: /x\nnames:\n  0: a\n  1: ü\n"
    assert names_in(tmp_path / "data.yaml") == ["a", "ü"]
    (tmp_path / "data.yaml").write_text("names: {1: a}")
    with pytest.raises(DatasetError, match="it has no names of classes by number; remove it"):
        names_in(tmp_path / "data.yaml")
