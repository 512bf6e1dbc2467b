"""YOLO's form, written and read."""

import pytest

from services.toolbox.labels import yolo
from services.toolbox.labels.objects import LabelsError, box_of, object_of
from tests.services.toolbox.labels.making import MANY, NAMES, POLYGON, SQUARE

ARCHIVE = {
    "data.yaml": "names:\n  0: pallet\n  1: box\ntrain: train.txt\n",
    "train.txt": "data/images/train/a.jpg\n",
    "labels/train/a.b.txt": POLYGON,
    "labels/train/none.txt": "\n",
    "README.txt": "not labels",
}


def test_lines_are_polygons_and_boxes() -> None:
    polygon, square, box = yolo.objects_of(f"{POLYGON}\n{SQUARE}1 0.5 0.5 0.2 0.4\n", NAMES, "a.txt")
    assert polygon.polygon.tolist() == [[0.1, 0.1], [0.5, 0.1], [0.3, 0.8]]
    assert [each.is_box for each in (polygon, square, box)] == [False, False, True]
    assert box.polygon == pytest.approx(box_of("pallet", (0.4, 0.3, 0.2, 0.4), (1, 1), "").polygon)
    assert [each.is_box for each in yolo.objects_of(SQUARE + MANY, NAMES, "a.txt", boxes=True)] == [True, False]


def test_lines_are_written_as_they_were_read() -> None:
    text = POLYGON + SQUARE + MANY
    assert yolo.text_of(yolo.objects_of(text, NAMES, ""), NAMES) == text
    assert yolo.text_of((), NAMES) == ""


def test_beside_boxes_a_polygon_of_four_corners_gets_a_fifth() -> None:
    box, polygon = box_of("box", (0, 0, 1, 1), (1, 1), ""), object_of("box", [0, 0, 1, 0, 1, 1, 0, 1], (1, 1), "")
    first, second = yolo.text_of([box, polygon], NAMES).splitlines()
    assert first == "0 0.00000 0.00000 1.00000 0.00000 1.00000 1.00000 0.00000 1.00000"
    assert second == f"{first} 0.00000 0.50000"


def test_an_archive_maps_classes_by_name_and_knows_what_is_empty() -> None:
    found = list(yolo.read(list(ARCHIVE), ARCHIVE.__getitem__, "a.zip"))
    assert [(each.name, each.place) for each in found] == [
        ("a.b", "a.zip: labels/train/a.b.txt"),
        ("none", "a.zip: labels/train/none.txt"),
    ]
    assert [[each.name for each in labels.objects or ()] for labels in found] == [["pallet"], []]


def test_classes_may_be_in_a_file_of_their_own() -> None:
    files = {"classes.txt": "cage\ntote\n", "labels/a.txt": SQUARE}
    (found,) = yolo.read(list(files), files.__getitem__, "a.zip")
    assert [each.name for each in found.objects or ()] == ["tote"]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("x 0 0 1 0 1 1", "not the number of a class and a polygon or box"),
        ("0 0 0 1 0 1 y", "not the number of a class and a polygon or box"),
        ("3 0 0 1 0 1 1", "no class has the number 3; there are 3: box, pallet"),
        ("-1 0 0 1 0 1 1", "no class has the number -1"),
        ("0 0 0 1 0 1", "5 numbers are no polygon of x and y"),
        ("0", "box has no area within the picture"),
        ("0 0 0 1 1", None),
        ("0 0.5 0.5 0 1", "box has no area within the picture"),
        ("0 0 0 nan 0 1 1", "a coordinate is not a finite number"),
        ("0 0 0 1e999 0 1 1", "a coordinate is not a finite number"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(line: str, reason: str | None) -> None:
    if reason is None:
        assert yolo.objects_of(line, NAMES, "a.txt")
        return
    with pytest.raises(LabelsError) as caught:
        yolo.objects_of(f"{POLYGON}{line}\n", NAMES, "a.txt")
    assert str(caught.value).startswith(f"a.txt, line 2: {reason}")


@pytest.mark.parametrize(
    ("names", "reason"),
    [
        ({}, "a.zip: no data.yaml or classes.txt names the classes"),
        ({"data.yaml": "names: {1: box}"}, "a.zip: data.yaml: it names no classes by number"),
        ({"data.yaml": "{"}, "a.zip: data.yaml: it names no classes by number"),
        ({"data.yaml": "a: &a [x]\nnames: [*a, *a]"}, "a.zip: data.yaml: it names no classes by number"),
    ],
)
def test_without_names_of_classes_it_is_refused(names: dict[str, str], reason: str) -> None:
    files = {**names, "labels/a.txt": POLYGON}
    with pytest.raises(LabelsError) as caught:
        list(yolo.read(list(files), files.__getitem__, "a.zip"))
    assert str(caught.value).startswith(reason)
