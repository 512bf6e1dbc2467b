"""What `services.detector.model.Model` promises, held against the fake and the shipped model."""

import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.detections import Detection
from services.detector.one_by_one import ImageModel as Model
from services.detector.settings import DetectorSettings
from services.detector.ultralytics_model import load
from tests.services.detector.fakes import FakeModel
from tests.services.detector.views import near_view


@pytest.fixture(scope="module", params=["fake", "shipped"])
def model(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Model:
    return FakeModel() if request.param == "fake" else load(DetectorSettings(), tmp_path_factory.mktemp("ultralytics"))


@pytest.fixture(scope="module")
def view() -> NDArray[np.uint8]:
    """Look at a forklift, boxes and a pallet, in BGR."""
    return near_view()


def inside(found: Detection, height: int, width: int) -> bool:
    box = found.box
    return 0 <= box.x1 < box.x2 <= width and 0 <= box.y1 < box.y2 <= height


def test_objects_are_named_scored_inside_the_image_and_best_first(model: Model, view: NDArray[np.uint8]) -> None:
    found = model.infer(view, masks=False)
    assert found
    assert all(inside(each, *view.shape[:2]) and each.name for each in found)
    scores = [each.score for each in found]
    assert scores == sorted(scores, reverse=True)
    assert all(0 < score <= 1 for score in scores)


def test_masks_only_when_asked_for_and_of_the_images_size(model: Model, view: NDArray[np.uint8]) -> None:
    assert all(each.mask is None for each in model.infer(view, masks=False))
    assert all(each.mask is not None and each.mask.size == view.shape[:2] for each in model.infer(view, masks=True))


@pytest.mark.parametrize("shape", [(1, 1, 3), (7, 5, 3), (480, 848, 3), (1080, 64, 3)])
def test_any_size_of_image_will_do(model: Model, shape: tuple[int, int, int]) -> None:
    for each in model.infer(np.zeros(shape, np.uint8), masks=True):
        assert inside(each, *shape[:2])


def test_the_same_image_gives_the_same_objects(model: Model, view: NDArray[np.uint8]) -> None:
    assert model.infer(view, masks=True) == model.infer(view, masks=True)
    assert model.name


def test_every_class_has_a_number_of_its_own(model: Model, view: NDArray[np.uint8]) -> None:
    found = {(each.name, each.label) for each in model.infer(view, masks=False)}
    assert len(found) == len({name for name, _ in found}) == len({label for _, label in found})
