"""A data-set folder that grows over several runs."""

import json
from pathlib import Path

import pytest
import yaml

from schemas.detections import Detections
from schemas.keys import CameraKey
from services.data_folder import DatasetError
from services.toolbox.collect.dataset import Dataset
from services.toolbox.collect.pictures import picture_of
from tests.fleetsight.stand_in import FOUND
from tests.schemas.frames import image

NAMES = ["pallet", "box"]
FRONT = CameraKey("r1", "front")


def saved(dataset: Dataset, found: Detections | None = FOUND, seq: int = 0, hidden: tuple[str, ...] = ()) -> Path:
    return dataset.save(picture_of(image(seq=seq)), "every 5 s", found, "train", hidden)


def test_pictures_labels_names_and_where_they_are_from(tmp_path: Path) -> None:
    dataset = Dataset.open(tmp_path / "site", NAMES)
    file = saved(dataset)
    assert file == tmp_path / "site/train/images/r1-front_1700000000000000000.jpg"
    lines = (tmp_path / "site/train/labels/r1-front_1700000000000000000.txt").read_text().splitlines()
    assert [line.split()[0] for line in lines] == ["1", "1"]
    about = json.loads((tmp_path / "site/collected.jsonl").read_text())
    assert {name: about[name] for name in ("file", "robot", "camera", "seq", "why", "drafts_by")} == {
        "file": "train/images/r1-front_1700000000000000000.jpg",
        "robot": "r1",
        "camera": "front",
        "seq": 0,
        "why": "every 5 s",
        "drafts_by": "stand-in",
    }
    data = yaml.safe_load((tmp_path / "site/data.yaml").read_text())
    assert data == {
        "path": str(tmp_path / "site"),
        "train": "train/images",
        "val": "val/images",
        "test": "test/images",
        "names": {0: "pallet", 1: "box"},
    }
    assert (dataset.count, dataset.size) == (1, file.stat().st_size)
    assert not list((tmp_path / "site").rglob(".*"))


def test_it_goes_on_with_what_was_collected_before(tmp_path: Path) -> None:
    before = Dataset.open(tmp_path, NAMES)
    saved(before)
    after = Dataset.open(tmp_path, ["box", "forklift"])
    assert (after.names, after.count, after.size) == (["pallet", "box", "forklift"], 1, before.size)
    known = picture_of(image()).fingerprint
    assert after.is_known(FRONT, known, 1)
    assert not after.is_known(FRONT, known, 0)
    assert not after.is_known(CameraKey("r1", "rear"), known, 1)
    assert not after.is_known(FRONT, known ^ 0b111, 3)
    assert after.is_known(FRONT, known ^ 0b111, 4)


def test_a_class_that_is_new_gets_the_next_number(tmp_path: Path) -> None:
    dataset = Dataset.open(tmp_path, ["pallet"])
    saved(dataset)
    assert dataset.names == ["pallet", "box"]
    assert yaml.safe_load((tmp_path / "data.yaml").read_text())["names"] == {0: "pallet", 1: "box"}


def test_what_is_hidden_has_no_labels_and_no_number(tmp_path: Path) -> None:
    dataset = Dataset.open(tmp_path, ["pallet"])
    file = saved(dataset, hidden=("box",))
    assert (file.parents[1] / "labels" / f"{file.stem}.txt").read_text() == ""
    assert dataset.names == ["pallet"]


def test_without_drafts_there_are_no_labels(tmp_path: Path) -> None:
    saved(Dataset.open(tmp_path, NAMES), None)
    assert not (tmp_path / "train/labels").exists()
    assert "drafts_by" not in json.loads((tmp_path / "collected.jsonl").read_text())


def test_a_line_that_a_killed_process_left_half_is_passed_over(tmp_path: Path) -> None:
    saved(Dataset.open(tmp_path, NAMES))
    with (tmp_path / "collected.jsonl").open("a") as record:
        record.write('{"file": "tr')
    after = Dataset.open(tmp_path, NAMES)
    assert after.count == 1
    saved(after, seq=1)
    assert Dataset.open(tmp_path, NAMES).count == 2


def test_a_data_set_of_another_tool_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "data.yaml").write_text("names: {0: tote}")
    with pytest.raises(DatasetError, match="a data set of another tool"):
        Dataset.open(tmp_path, NAMES)
    assert (tmp_path / "data.yaml").read_text() == "names: {0: tote}"


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("collected.jsonl", "{}\n{}\n", "line 1 is damaged; remove it"),
        ("data.yaml", "names: [", "it has no names of classes by number; remove it"),
        ("data.yaml", "names: {1: box}", "it has no names of classes by number; remove it"),
        ("data.yaml", "train: images", "it has no names of classes by number; remove it"),
    ],
)
def test_a_damaged_folder_is_refused(name: str, content: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "collected.jsonl").touch()
    (tmp_path / name).write_text(content)
    with pytest.raises(DatasetError, match=f"{name}: {why}"):
        Dataset.open(tmp_path, NAMES)


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DatasetError, match="file"):
        Dataset.open(tmp_path / "file/site", NAMES)
