"""The data-set folder: what is refused in it, and what replaces its labels."""

from pathlib import Path

import pytest

from services.data_folder import DatasetError, Origin
from services.toolbox.collect.dataset import Dataset
from services.toolbox.collect.pictures import picture_of
from services.toolbox.labels.folder import DataFolder
from services.toolbox.labels.objects import LabelsError, PictureLabels, object_of
from tests.fleetsight.stand_in import FOUND
from tests.schemas.frames import image
from tests.services.toolbox.labels.making import POLYGON, labels, picture, record, site, texts

TRIANGLE = object_of("box", [0, 0, 1, 0, 1, 1], (1, 1), "")


def test_pictures_of_all_splits_and_whose_labels_they_have(tmp_path: Path) -> None:
    site(tmp_path, {"train/images/a.jpg": POLYGON, "val/images/b.jpg": None, "test/images/c.PNG": ""})
    picture(tmp_path / "train/images/d.jpg")
    labels(tmp_path, "train/images/d.jpg", POLYGON)
    folder = DataFolder(tmp_path)
    found = {each.path: (each.by, None if each.objects is None else len(each.objects)) for each in folder.labels()}
    assert found == {
        "train/images/a.jpg": ("warehouse.pt", 1),
        "train/images/d.jpg": ("unknown", 1),
        "val/images/b.jpg": ("", None),
        "test/images/c.PNG": ("warehouse.pt", 0),
    }
    folder.replace([(folder.pictures["a.jpg"], (TRIANGLE,))], {"by": "cvat"})
    again = DataFolder(tmp_path)
    assert again.origins.of(again.pictures["a.jpg"].file) is Origin.PERSON
    (line,) = record(tmp_path)
    assert {**line, "at": ""} == {
        "file": "train/images/a.jpg",
        "at": "",
        "by": "cvat",
        "objects": 1,
        "as_before": False,
    }


def test_a_picture_is_found_by_its_name_or_without_suffix(tmp_path: Path) -> None:
    folder = DataFolder(site(tmp_path, {"train/images/a.b.jpg": POLYGON}))
    assert folder.find(PictureLabels("a.b.jpg", "", ())) is folder.find(PictureLabels("a.b", "", ()))
    assert folder.find(PictureLabels("a", "", ())) is None
    assert folder.find(PictureLabels("../train/images/a.b.jpg", "", ())) is None
    with pytest.raises(LabelsError, match=r"line 3: the labels are of a picture of 20 x 10 pixels, but train/images/a"):
        folder.find(PictureLabels("a.b.jpg", "a.xml, line 3", (), (20, 10)))


def test_what_a_killed_process_left_of_a_line_is_removed(tmp_path: Path) -> None:
    site(tmp_path, {"train/images/a.jpg": POLYGON, "train/images/b.jpg": POLYGON})
    (tmp_path / "labelled.jsonl").write_text('{"file": "train/images/b.jpg"}\n{"file": "tra', encoding="utf-8")
    folder = DataFolder(tmp_path)
    assert folder.replace([(folder.pictures["a.jpg"], (TRIANGLE,))], {}) == 0
    assert [each["file"] for each in record(tmp_path)] == ["train/images/b.jpg", "train/images/a.jpg"]


def test_damaged_labels_can_be_replaced(tmp_path: Path) -> None:
    folder = DataFolder(site(tmp_path, {"train/images/a.jpg": "nonsense"}))
    with pytest.raises(LabelsError, match=r"train/labels/a\.txt, line 1: not the number of a class"):
        list(folder.labels())
    folder.replace([(folder.pictures["a.jpg"], ())], {})
    assert texts(tmp_path) == {"a.txt": ""}
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (
            {"val/images/a.jpg": b""},
            "train/images/a.jpg and val/images/a.jpg have the same name, and tools go by names",
        ),
        ({"train/images/a.png": b""}, "train/images/a.jpg and train/images/a.png have the same name"),
        ({"train/images/b\n.jpg": b""}, r"train/images/b\n.jpg: other tools cannot take this name; rename it"),
        ({"data.yaml": b"names: [a, a]"}, "data.yaml: other tools know classes by name, which 'a' is not; rename it"),
        ({"data.yaml": b"names: ['a\\b']"}, None),
        ({"data.yaml": b'names: ["\\e"]'}, r"data.yaml: other tools know classes by name, which '\x1b' is not"),
        ({"data.yaml": b"names: {}"}, "no data.yaml names the classes; write one, such as names: {0: box"),
    ],
)
def test_folders_that_no_tool_can_take_are_refused(spoil: dict[str, bytes], reason: str | None, tmp_path: Path) -> None:
    site(tmp_path, {"train/images/a.jpg": POLYGON})
    for name, content in spoil.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    if reason is None:
        assert DataFolder(tmp_path).names == ["a\\b"]
        return
    with pytest.raises(LabelsError) as caught:
        DataFolder(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path}: {reason}")


def test_folders_without_pictures_or_with_damaged_records(tmp_path: Path) -> None:
    with pytest.raises(LabelsError, match="no pictures in train/images or val/images or test/images; name a folder as"):
        DataFolder(tmp_path / "none")
    site(tmp_path, {"train/images/a.jpg": POLYGON})
    (tmp_path / "boxes_only.txt").write_bytes(b"\xff\n")
    with pytest.raises(LabelsError, match=r"boxes_only\.txt: not UTF-8; save it as UTF-8, or remove it"):
        DataFolder(tmp_path)
    (tmp_path / "boxes_only.txt").unlink()
    for damaged in ("\udcff\n", "{\n", "[]\n", '{"line": 1}\n'):
        (tmp_path / "labelled.jsonl").write_text(damaged, errors="surrogateescape")
        with pytest.raises(DatasetError, match=r"labelled\.jsonl: line 1 is damaged; remove it"):
            DataFolder(tmp_path)


def test_pictures_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    site(tmp_path, {"train/images/a.jpg": POLYGON})
    (tmp_path / "train/images/a.jpg").write_bytes(b"\xff\xd8\xff nonsense")
    with pytest.raises(LabelsError, match=r"train/images/a\.jpg: not a picture that can be read; remove it"):
        list(DataFolder(tmp_path).labels())
    (tmp_path / "train/labels/a.txt").write_bytes(b"\xff")
    with pytest.raises(LabelsError, match=r"train/labels/a\.txt: not UTF-8; remove it, or label its picture again"):
        list(DataFolder(tmp_path).labels())


@pytest.mark.parametrize(("orientation", "size"), [(1, (30, 20)), (3, (30, 20)), (6, (20, 30)), (8, (20, 30))])
def test_sizes_are_those_of_the_picture_as_it_is_shown(orientation: int, size: tuple[int, int], tmp_path: Path) -> None:
    site(tmp_path, {"train/images/a.jpg": None})
    picture(tmp_path / "train/images/a.jpg", (30, 20), orientation)
    assert DataFolder(tmp_path).pictures["a.jpg"].size == size


def test_other_keys_of_data_yaml_stay(tmp_path: Path) -> None:
    site(tmp_path, {"train/images/a.jpg": POLYGON})
    (tmp_path / "data.yaml").write_text("names: [box]\nnc: 1\nlicense: ü\n", encoding="utf-8")
    folder = DataFolder(tmp_path)
    folder.replace([(folder.pictures["a.jpg"], (object_of("new", [0, 0, 1, 0, 1, 1], (1, 1), ""),))], {})
    assert DataFolder(tmp_path).names == ["box", "new"]
    assert "nc: 2\nlicense: ü\n" in (tmp_path / "data.yaml").read_text(encoding="utf-8")


def test_a_folder_as_collecting_makes_it(tmp_path: Path) -> None:
    dataset = Dataset.open(tmp_path, ["pallet"])
    file = dataset.save(picture_of(image()), "every 5 s", FOUND, "train", ())
    folder = DataFolder(tmp_path)
    (found,) = folder.labels()
    assert (found.path, found.by) == (f"train/images/{file.name}", "stand-in")
    assert [each.name for each in found.objects or ()] == ["box", "box"]
    folder.replace([(folder.pictures[file.name], (object_of("tote", [0, 0, 1, 0, 1, 1], (1, 1), ""),))], {})
    assert Dataset.open(tmp_path, []).names == ["pallet", "box", "tote"]
