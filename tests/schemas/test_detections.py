import pytest

from schemas.detections import Box, ClassCount, Detection, Detections, Mask, class_list
from schemas.errors import SchemaError
from tests.schemas.frames import header


def found(*names_and_scores: tuple[str, float]) -> Detections:
    objects = [Detection(name=name, score=score, box=Box(0, 0, 1, 1)) for name, score in names_and_scores]
    return Detections(header=header(), height=4, width=6, objects=objects, model="m", worker="w", spans={"model": 5})


def test_class_list_counts_by_name_with_the_best_score() -> None:
    listed = class_list(found(("pallet", 0.9), ("box", 0.4), ("box", 0.6)))
    assert listed.classes == [ClassCount("box", 2, 0.6), ClassCount("pallet", 1, 0.9)]
    assert (listed.header, listed.model, listed.worker, listed.spans) == (header(), "m", "w", {"model": 5})


def test_an_empty_view_is_an_empty_list() -> None:
    assert class_list(found()).classes == []


def test_masks_have_the_images_size() -> None:
    fitting = Detection(name="box", score=1, box=Box(0, 0, 1, 1), mask=Mask((4, 6), "0"))
    Detections(header=header(), height=4, width=6, objects=[fitting], model="m", worker="w")
    with pytest.raises(SchemaError, match="mask of"):
        Detections(header=header(), height=6, width=4, objects=[fitting], model="m", worker="w")
