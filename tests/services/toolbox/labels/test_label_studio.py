"""Label Studio's form, written and read. Regions are as Label Studio 1.23.2 exports them."""

import json
from typing import Any, Final

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring

from services.toolbox.labels import label_studio
from services.toolbox.labels.objects import LabelsError, PictureLabels, box_of, object_of

SIZE: Final = (640, 480)
SHAPE: Final = {"original_width": 640, "original_height": 480, "image_rotation": 0, "origin": "manual"}
POLYGON: Final = {
    **SHAPE,
    "value": {"points": [[1, 1], [50, 1], [50, 105], [20, 60]], "polygonlabels": ["forklift"]},
    "id": "p",
    "from_name": "polygon",
    "to_name": "image",
    "type": "polygonlabels",
}
RECTANGLE: Final = {
    **SHAPE,
    "value": {"x": 50, "y": 50, "width": 20, "height": 10, "rotation": 30, "rectanglelabels": ["pallet"]},
    "type": "rectanglelabels",
}


def task(*results: list[dict[str, Any]], **data: Any) -> dict[str, Any]:
    """Return an exported task with an annotation of each of the results."""
    common = {"completed_by": 1, "was_cancelled": False, "ground_truth": False, "lead_time": 3.0}
    annotations = [
        {"id": n, **common, "result": result, "updated_at": f"2026-11-28T17:47:2{n}.983767Z"}
        for n, result in enumerate(results)
    ]
    about = {"image": "/data/local-files/?d=site/train/images/a%20%C3%BC%20%231.jpg", **data}
    return {"id": 6, "annotations": annotations, "data": about, "meta": {}, "project": 1}


def read(*tasks: dict[str, Any]) -> list[PictureLabels]:
    return list(label_studio.read(json.dumps(tasks).encode(), "a.json"))


def test_regions_as_label_studio_exports_them() -> None:
    (found,) = read(task([POLYGON, RECTANGLE, {**RECTANGLE, "value": {**RECTANGLE["value"], "rotation": 0}}]))  # type: ignore[dict-item]
    assert (found.name, found.size, found.place) == ("a ü #1.jpg", SIZE, "a.json: [0] (task 6)")
    assert found.objects is not None
    polygon, turned, box = found.objects
    assert polygon.polygon.tolist() == [[0.01, 0.01], [0.5, 0.01], [0.5, 1], [0.2, 0.6]]
    corners = np.array([(0.5, 0.5), (0.67321, 0.63333), (0.63571, 0.71994), (0.4625, 0.5866)])
    assert turned.polygon == pytest.approx(corners, abs=1e-5)
    assert (turned.is_box, box.is_box) == (False, True)
    assert box.polygon[2] == pytest.approx((0.7, 0.6))


def test_none_there_is_another_thing_than_not_labelled_or_skipped() -> None:
    skipped = task([])
    skipped["annotations"][0]["was_cancelled"] = True
    assert [each.objects for each in read(task([]), task(), skipped)] == [(), None, None]


def test_of_several_annotations_the_one_that_was_changed_last_counts() -> None:
    (found,) = read(task([], [POLYGON]))
    assert len(found.objects or ()) == 1
    both = task([POLYGON], [])
    both["annotations"][1]["was_cancelled"] = True
    assert len(read(both)[0].objects or ()) == 1


@pytest.mark.parametrize(
    ("data", "name"),
    [
        ({"file": "val/images/b_1.jpg"}, "b_1.jpg"),
        ({"image": "/data/upload/1/0a1b2c3d-r1-front_1.jpg"}, "r1-front_1.jpg"),
        ({"image": "http://central/site/train/images/a%201.jpg?x=1#y"}, "a 1.jpg"),
        ({"image": "/data/local-files/?d=site/0a1b2c3d-1.jpg"}, "0a1b2c3d-1.jpg"),
    ],
)
def test_pictures_are_known_by_name(data: dict[str, str], name: str) -> None:
    assert read(task(**data))[0].name == name


def test_tasks_have_predictions_or_annotations() -> None:
    polygon = object_of("ü", [0, 0, 320, 0, 320, 480], SIZE, "")
    box = box_of("box", (64, 48, 128, 48), SIZE, "")
    pictures = [
        PictureLabels("1.jpg", "", (polygon, box), SIZE, "train/images/ü #1.jpg", by="warehouse.pt"),
        PictureLabels("2.jpg", "", (), SIZE, "val/images/2.jpg"),
        PictureLabels("3.jpg", "", None, SIZE, "val/images/3.jpg"),
    ]
    drafted, seen, unlabelled = json.loads(label_studio.write(pictures, label_studio.local_address("my site")))
    assert drafted["data"] == {
        "image": "/data/local-files/?d=my%20site/train/images/%C3%BC%20%231.jpg",
        "file": "train/images/ü #1.jpg",
    }
    (prediction,) = drafted["predictions"]
    assert prediction["model_version"] == "warehouse.pt"
    first, second = prediction["result"]
    assert (first["original_width"], first["original_height"], first["from_name"]) == (640, 480, "polygon")
    assert first["value"] == {"points": [[0, 0], [50, 0], [50, 100]], "closed": True, "polygonlabels": ["ü"]}
    expected = {"x": 10, "y": 10, "width": 20, "height": 10, "rotation": 0, "rectanglelabels": ["box"]}
    assert {**second["value"], "width": round(second["value"]["width"], 9)} == expected
    assert (seen["annotations"], "predictions" in seen) == ([{"result": []}], False)
    assert unlabelled.keys() == {"data"}


def test_the_interface_has_every_class_as_polygon_and_as_rectangle() -> None:
    root = fromstring(label_studio.interface(["box", '<"ü&>']))
    for tag, name in (("PolygonLabels", "polygon"), ("RectangleLabels", "box")):
        (control,) = root.iterfind(tag)
        assert (control.get("name"), control.get("toName")) == (name, "image")
        assert [each.get("value") for each in control] == ["box", '<"ü&>']


@pytest.mark.parametrize(
    ("region", "reason"),
    [
        (
            {"type": "brushlabels", "value": {"format": "rle", "rle": [0, 1]}},
            "a region of the type 'brushlabels' is no",
        ),
        (
            {**POLYGON, "value": {"points": [[1, 1], [2, 2]], "polygonlabels": ["a"]}},
            "a has no area within the picture",
        ),
        ({**POLYGON, "value": {"points": [[1, 1], [9, 1], [9, 9]]}}, "a region has 0 classes; give it one"),
        ({**RECTANGLE, "value": {"rectanglelabels": ["a", "b"]}}, "a region has 2 classes; give it one"),
        ({**RECTANGLE, "image_rotation": 90}, "a region was drawn on a picture that was turned in the tool"),
    ],
)
def test_what_is_wrong_is_named_with_its_task(region: dict[str, Any], reason: str) -> None:
    with pytest.raises(LabelsError) as caught:
        read(task([region]))
    assert str(caught.value).startswith(f"a.json: [0] (task 6): {reason}")


def test_regions_of_several_sizes_are_refused() -> None:
    with pytest.raises(LabelsError, match="its regions are of pictures of several sizes"):
        read(task([POLYGON, {**RECTANGLE, "original_width": 9}]))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (
            [{"image": "a.jpg", "polygon": []}],
            "a.json: [0]: object missing required field `data`; export it again, as JSON",
        ),
        ([{"data": {"text": "a"}, "annotations": []}], "a.json: [0].data: object missing required field `image`"),
        ([task(image="http://[")], "a.json: [0] (task 6): 'http://[' names no picture"),
        ([task(image="/")], "a.json: [0] (task 6): '/' names no picture"),
        ({}, "a.json: expected `array`, got `object`; export it again, as JSON of Label Studio"),
    ],
)
def test_files_that_are_not_of_the_form(content: Any, reason: str) -> None:
    with pytest.raises(LabelsError) as caught:
        list(label_studio.read(json.dumps(content).encode(), "a.json"))
    assert str(caught.value).startswith(reason)
