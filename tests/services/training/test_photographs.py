from pathlib import Path

import numpy as np
import pytest
import yaml

from services.training.files import TrainingError
from services.training.photographs import classes_of, doubts_of, read_licences, read_photographs

BOX, PALLET, FORKLIFT = range(3)


def folder_with(folder: Path, labels: dict[str, str], **files: str) -> Path:
    """Write pictures of no content with labels, and the files that say how far these go."""
    for kind in ("images", "labels"):
        (folder / "train" / kind).mkdir(parents=True)
    for name, text in labels.items():
        (folder / "train" / "images" / f"{name}.jpg").write_bytes(b"")
        (folder / "train" / "labels" / f"{name}.txt").write_text(text)
    for name, text in files.items():
        (folder / f"{name}.txt").write_text(text)
    return folder


def test_objects_have_their_polygons_and_boxes(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, {"yard_1": "1 0.1 0.2 0.5 0.2 0.3 0.8\n"})
    (photograph,) = read_photographs(folder, "train")
    (pallet,) = photograph.objects
    assert (photograph.source, pallet.class_index, pallet.box_only) == ("yard", PALLET, False)
    assert pallet.box == pytest.approx((0.1, 0.2, 0.5, 0.8))
    assert not photograph.unknown


def test_the_detection_form_is_a_box_without_a_mask(tmp_path: Path) -> None:
    (photograph,) = read_photographs(folder_with(tmp_path, {"a_1": "2 0.5 0.5 0.2 0.4\n"}), "train")
    (forklift,) = photograph.objects
    assert forklift.box_only
    assert forklift.box == pytest.approx((0.4, 0.3, 0.6, 0.7))


def test_a_listed_picture_has_boxes_but_polygons_of_more_corners_are_masks(tmp_path: Path) -> None:
    labels = {"a_1": "0 0 0 1 0 1 1 0 1\n0 0 0 1 0 1 1 0.5 0.5 0 1\n"}
    folder = folder_with(tmp_path, labels, boxes_only="test/images/a_1.jpg\n")
    (photograph,) = read_photographs(folder, "train")
    assert [each.box_only for each in photograph.objects] == [True, False]


def test_sources_say_which_classes_they_label(tmp_path: Path) -> None:
    told = (
        "# a comment\n"
        "rack\tlabelled=box\tabsent=forklift\tunknown=pallet\n"
        "empty\tlabelled=\tabsent=box,pallet,forklift\n"
    )
    folder = folder_with(tmp_path, {"empty_1": "", "other_1": "", "rack_1": ""}, incomplete=told)
    empty, other, rack = read_photographs(folder, "train")
    assert rack.absent == {FORKLIFT}
    assert rack.unknown == {PALLET}
    assert empty.absent == {BOX, PALLET, FORKLIFT}
    assert not empty.unknown
    assert not other.absent | other.unknown


def test_points_outside_the_picture_are_moved_to_its_edge(tmp_path: Path) -> None:
    (photograph,) = read_photographs(folder_with(tmp_path, {"a_1": "0 -0.1 0 1.2 0 1 1\n"}), "train")
    assert np.all((photograph.objects[0].polygon >= 0) & (photograph.objects[0].polygon <= 1))


@pytest.mark.parametrize("line", ["0 0.1", "x 0 0 1 1 0 1", "3 0 0 1 0 1 1", "0 nan 0 1 0 1 1", "0 0.1 0.2"])
def test_a_bad_label_is_named_with_its_line(tmp_path: Path, line: str) -> None:
    folder = folder_with(tmp_path, {"a_1": f"0 0 0 1 0 1 1\n{line}\n"})
    with pytest.raises(TrainingError, match=r"a_1\.txt, line 2"):
        read_photographs(folder, "train")


def test_a_class_that_there_is_not_is_refused(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, {"a_1": ""}, incomplete="a\tlabelled=crate\n")
    with pytest.raises(TrainingError, match=r"no class 'crate'; there are box, pallet, forklift"):
        read_photographs(folder, "train")


def test_a_folder_without_pictures_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="no pictures in val/images or test/images"):
        read_photographs(tmp_path, "val", "test")


def test_licences_are_read_by_source(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, {}, licences="# comment\nyard\tCC BY 4.0\texample.org, by A\n")
    assert read_licences(folder) == {"yard": "CC BY 4.0: example.org, by A"}
    (tmp_path / "licences.txt").write_text("yard CC BY\n")
    with pytest.raises(TrainingError, match="not a source, its licence and its origin"):
        read_licences(folder)


def test_folders_say_how_many_of_their_labels_nobody_corrected(tmp_path: Path) -> None:
    drafted = folder_with(tmp_path / "a", {"a_1": "", "a_2": "", "a_3": ""})
    lines = (f'{{"file": "train/images/a_{number}.jpg", "drafts_by": "m"}}\n' for number in (1, 2))
    (drafted / "collected.jsonl").write_text("".join(lines))
    (drafted / "train/labels/a_3.txt").unlink()
    other = folder_with(tmp_path / "b", {"b_1": ""})
    assert list(doubts_of([drafted, other])) == [
        (
            f"{drafted}: of 3 pictures 2 have drafts of labels that nobody corrected, 1 have no labels and count as"
            f" empty; see fleetsight labels check {drafted}"
        )
    ]
    (drafted / "labelled.jsonl").write_text("?\n")
    with pytest.raises(TrainingError, match=r"labelled\.jsonl: line 1 is damaged; remove it"):
        list(doubts_of([drafted]))


def test_classes_go_by_name_and_one_that_a_folder_does_not_name_is_unknown_there(tmp_path: Path) -> None:
    own = folder_with(tmp_path / "own", {"a_1": "1 0 0 1 0 1 1\n"})
    (own / "data.yaml").write_text("names: [pallet, tote]")
    other = folder_with(tmp_path / "other", {"b_1": "1 0 0 1 0 1 1\n"})
    classes = classes_of([own, other])
    assert classes == ("pallet", "tote", "box", "forklift")
    (here,), (there,) = (read_photographs(each, "train", classes=classes) for each in (own, other))
    assert [each.class_index for each in (*here.objects, *there.objects)] == [1, 0]
    assert here.unknown == {2, 3}
    assert there.unknown == {1}


def test_without_others_a_folder_s_classes_are_its_own(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, {"a_1": "0 0 0 1 0 1 1\n"}, incomplete="a\tlabelled=tote\tunknown=cage\n")
    (folder / "data.yaml").write_text("names: {0: tote, 1: cage}")
    (photograph,) = read_photographs(folder, "train")
    assert photograph.objects[0].class_index == 0
    assert photograph.unknown == {1}


def test_a_class_that_is_named_twice_is_refused(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, {"a_1": ""})
    (folder / "data.yaml").write_text("names: [box, box]")
    with pytest.raises(TrainingError, match=r"data\.yaml: names a class twice; give each"):
        read_photographs(folder, "train")


@pytest.mark.parametrize(
    ("names", "classes"),
    [
        ("[pallet, forklift, box]", ("box", "pallet", "forklift")),
        ("[]", ("box", "pallet", "forklift")),
        ("[pallet, box]", ("pallet", "box")),
        ("[tote, forklift, box, pallet]", ("tote", "forklift", "box", "pallet")),
    ],
)
def test_the_simulator_s_classes_alone_are_in_its_order(tmp_path: Path, names: str, classes: tuple[str, ...]) -> None:
    folder = folder_with(tmp_path, {"a_1": "1 0 0 1 0 1 1\n"})
    (folder / "data.yaml").write_text(f"names: {names}")
    assert classes_of([folder]) == classes
    (photograph,) = read_photographs(folder, "train")
    numbered = yaml.safe_load(names) or classes
    assert classes[photograph.objects[0].class_index] == numbered[1], "as its number says in that file"
