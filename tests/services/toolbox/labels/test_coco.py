"""COCO's form, written and read, with pycocotools as the other side."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import pytest
from pycocotools import mask as coco_masks
from pycocotools.coco import COCO

from services.toolbox.labels import coco
from services.toolbox.labels.objects import LabelsError, PictureLabels, box_of, object_of

SIZE: Final = (40, 20)
IMAGE: Final = {"id": 1, "file_name": "C:\\photos\\a_1.jpg", "width": 40, "height": 20}
L_SHAPE: Final = np.zeros((20, 40), np.uint8)
L_SHAPE[2:18, 5:15] = L_SHAPE[10:18, 5:35] = 1


def content(annotation: Mapping[str, Any], **other: Any) -> bytes:
    """Return a file of one image and one annotation."""
    whole: dict[str, Any] = {"images": [IMAGE], "categories": [{"id": 7, "name": "box"}]}
    about = {"id": 1, "image_id": 1, "category_id": 7, **annotation}
    return json.dumps({**whole, "annotations": [about], **other}).encode()


def read(annotation: Mapping[str, Any]) -> PictureLabels:
    (found,) = coco.read(content(annotation), "a.json")
    return found


def area_of(found: PictureLabels) -> int:
    """Return in how many pixels the only object's polygon is."""
    assert found.objects is not None
    (each,) = found.objects
    corners = np.round(each.polygon * SIZE - 0.5).astype(np.int32)
    return int(cv2.fillPoly(np.zeros((20, 40), np.uint8), [corners], 1).sum())


def test_polygons_boxes_and_several_parts() -> None:
    found = read({"segmentation": [[0, 0, 20, 0, 20, 20]], "bbox": [0, 0, 20, 20]})
    assert (found.name, found.size, found.place) == ("a_1.jpg", SIZE, "a.json: images[0]")
    assert found.objects is not None
    assert found.objects[0].polygon.tolist() == [[0, 0], [0.5, 0], [0.5, 1]]
    (box,) = read({"segmentation": [], "bbox": [10, 5, 20, 50]}).objects or ()
    assert (box.name, box.is_box) == ("box", True)
    assert box.polygon.tolist() == [[0.25, 0.25], [0.75, 0.25], [0.75, 1], [0.25, 1]]
    parts = [[0, 0, 10, 0, 10, 10, 0, 10], [20, 0, 40, 0, 40, 20, 20, 20]]
    assert area_of(read({"segmentation": parts})) == pytest.approx(500, abs=70)


@pytest.mark.parametrize("compressed", [True, False])
def test_masks_become_polygons_around_the_same_pixels(*, compressed: bool) -> None:
    runs = coco_masks.encode(np.asfortranarray(L_SHAPE))
    flat = L_SHAPE.T.ravel()
    lengths = np.diff(np.flatnonzero(np.diff(np.concatenate([[1 - 0], flat, [2]])) != 0)).tolist()
    counts = runs["counts"].decode() if compressed else [int(np.argmax(flat)), *lengths[1:]]
    found = read({"segmentation": {"size": [20, 40], "counts": counts}, "iscrowd": 1})
    assert area_of(found) == L_SHAPE.sum()


def test_pycocotools_reads_what_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    polygon = object_of("pallet", [0, 0, 40, 0, 40, 20], SIZE, "")
    box = box_of("box", (10, 5, 20, 10), SIZE, "")
    pictures = [PictureLabels("ü 1.jpg", "", (polygon, box), SIZE), PictureLabels("2.jpg", "", None, (9, 9))]
    (tmp_path / "a.json").write_bytes(coco.write(pictures, ["box", "pallet"]))
    read_back = COCO(str(tmp_path / "a.json"))
    capsys.readouterr()
    assert [each["file_name"] for each in read_back.loadImgs([1, 2])] == ["ü 1.jpg", "2.jpg"]
    first, second = read_back.loadAnns(read_back.getAnnIds(imgIds=[1]))
    assert [each["name"] for each in read_back.loadCats([first["category_id"], second["category_id"]])] == [
        "pallet",
        "box",
    ]
    assert read_back.annToMask(first).sum() == pytest.approx(first["area"], abs=20)
    assert (first["area"], first["bbox"]) == (400, [0, 0, 40, 20])
    assert (second["bbox"], second["area"]) == ([10, 5, 20, 10], 200)


@pytest.mark.parametrize(
    ("annotation", "reason"),
    [
        (
            {"segmentation": [[0, 0, 5, 5]]},
            "annotations[0]: box has no area within the picture: it needs three corners",
        ),
        ({"segmentation": [[0, 0, 5, 5, 9, 9, 2, 2]]}, "annotations[0]: box has no area within the picture"),
        ({"segmentation": [[50, 0, 60, 0, 60, 20]]}, "annotations[0]: box has no area within the picture"),
        ({"segmentation": [[0, 0, 5]]}, "annotations[0]: the corners are not pairs of numbers"),
        ({"bbox": [0, 0, 5]}, "annotations[0]: a box is four finite numbers"),
        ({"bbox": [0, 0, 0, 9]}, "annotations[0]: box has no area"),
        ({}, "annotations[0]: it has neither segmentation nor bbox"),
        ({"image_id": 2, "bbox": [0, 0, 5, 5]}, "annotations[0]: its image or category is not in the file"),
        ({"bbox": ["0", 0, 5, 5]}, "annotations[0].bbox[0]: expected `float`, got `str`; export it again, as COCO"),
        ({"segmentation": {"size": [9, 9], "counts": [81]}}, "a mask of 9 x 9 pixels is not its image's size"),
        ({"segmentation": {"size": [20, 40], "counts": [800, 1]}}, "its runs do not fill a mask of 20 x 40 pixels"),
        ({"segmentation": {"size": [20, 40], "counts": [-1, 801]}}, "its runs do not fill a mask"),
        ({"segmentation": {"size": [20, 40], "counts": [800]}}, "the mask of box is too small; delete or redraw it"),
        ({"segmentation": {"size": [20, 40], "counts": "zzz"}}, "annotations[0]: runs that are not encoded"),
    ],
)
def test_what_is_wrong_is_named_with_its_place(annotation: dict[str, Any], reason: str) -> None:
    with pytest.raises(LabelsError) as caught:
        read(annotation)
    assert f"a.json: {reason}" in str(caught.value) or reason in str(caught.value)


@pytest.mark.parametrize(
    ("whole", "reason"),
    [
        (
            content({"bbox": [0, 0, 9, 9]}, images=[{**IMAGE, "file_name": ".."}]),
            "a.json: images[0]: '..' names no picture",
        ),
        (
            content({"bbox": [0, 0, 1, 1]}, images=[{**IMAGE, "width": 0}]),
            "annotations[0]: the picture is not 1 to 16384 pixels wide",
        ),
        (content({}, images=[IMAGE, IMAGE]), "a.json: two images or categories have the same id"),
        (
            content({"bbox": [0, 0, 9, 9]}, categories=[{"id": 7, "name": ""}]),
            "annotations[0]: not the name of a class",
        ),
        (content({})[:-9], "a.json, line 1: not JSON; it may have been cut off"),
        (b'{\n"images":\n?', "a.json, line 3: not JSON"),
        (b'{"x":' + b"[" * 100_000, "a.json, line 1: not JSON"),
        (b"\xff\xfe", "a.json, line 1: not JSON"),
        (b"{}", "a.json: object missing required field `images`; export it again, as COCO instances"),
    ],
)
def test_files_that_are_not_of_the_form(whole: bytes, reason: str) -> None:
    with pytest.raises(LabelsError) as caught:
        list(coco.read(whole, "a.json"))
    assert reason in str(caught.value)


def test_a_mask_that_claims_an_enormous_picture_is_refused_before_it_is_made() -> None:
    image = {**IMAGE, "width": 16_000, "height": 16_000}
    segmentation = {"size": [16_000, 16_000], "counts": [128_000_000, 128_000_000]}
    with pytest.raises(LabelsError, match="its runs do not fill a mask"):
        list(coco.read(content({"segmentation": segmentation}, images=[image]), "a.json"))
