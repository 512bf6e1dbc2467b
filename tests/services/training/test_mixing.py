from pathlib import Path

import numpy as np
import pytest
import yaml

from services.simulator.world import CLASSES
from services.training.files import TrainingError
from services.training.mixing import EMPTY_REPEATS, MOST_REPEATS, write_mix
from services.training.partial_labels import LabelKind, code_names
from services.training.photographs import LabelledObject, Photograph

BOX, PALLET, FORKLIFT = range(3)
CORNER = np.array([(0.0, 0.0), (0.5, 0.0), (0.5, 0.5)])


def photograph(file: Path, *objects: LabelledObject) -> Photograph:
    file.write_bytes(b"picture")
    return Photograph(file, "yard", objects, frozenset({FORKLIFT}), frozenset({PALLET}))


def test_labels_say_what_is_boxed_and_what_is_unknown(tmp_path: Path) -> None:
    objects = LabelledObject(BOX, CORNER), LabelledObject(BOX, CORNER, box_only=True)
    mix = write_mix(tmp_path / "mix", [photograph(tmp_path / "a.JPG", *objects)], [], CLASSES)
    lines = (mix.parent / "labels" / "000000.txt").read_text().splitlines()
    codes = [int(line.split()[0]) for line in lines]
    assert codes == [BOX, LabelKind.BOX_ONLY.code(BOX, 3), LabelKind.UNKNOWN_REGION.code(PALLET, 3)]
    assert lines[0].split()[1:] == ["0.00000", "0.00000", "0.50000", "0.00000", "0.50000", "0.50000"]
    assert (mix.parent / "images" / "000000.jpg").read_bytes() == b"picture"


@pytest.mark.parametrize(("rendered", "repeats"), [(0, 1), (1, 1), (3, 3), (100, MOST_REPEATS)])
def test_photographs_are_about_as_many_as_rendered_pictures(tmp_path: Path, rendered: int, repeats: int) -> None:
    pictures = [tmp_path / f"{number}.png" for number in range(rendered)]
    mix = write_mix(tmp_path / "mix", [photograph(tmp_path / "a.jpg")], pictures, CLASSES)
    described = yaml.safe_load(mix.read_text())
    listed = (mix.parent / described["train"]).read_text().splitlines()
    assert list(described["names"].values()) == code_names(CLASSES)
    assert listed.count(str((mix.parent / "images" / "000000.jpg").resolve())) == repeats
    assert listed[repeats:] == [str(path.resolve()) for path in pictures]


def test_photographs_without_the_classes_are_shown_more_often(tmp_path: Path) -> None:
    photographs = [photograph(tmp_path / "some.jpg", LabelledObject(BOX, CORNER)), photograph(tmp_path / "few.jpg")]
    (tmp_path / "none.jpg").write_bytes(b"picture")
    none = Photograph(tmp_path / "none.jpg", "garden", (), frozenset({PALLET, FORKLIFT}))
    mix = write_mix(tmp_path / "mix", [*photographs, none], [tmp_path / "a.png"] * 6, CLASSES)
    listed = [Path(line).stem for line in (mix.parent / "train.txt").read_text().splitlines()]
    assert [listed.count(f"{number:06d}") for number in range(3)] == [2, 2, 2 * EMPTY_REPEATS]


def test_a_picture_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    missing = Photograph(tmp_path / "gone.jpg", "yard", ())
    with pytest.raises(TrainingError, match=r"gone\.jpg: No such file"):
        write_mix(tmp_path / "mix", [missing], [], CLASSES)
