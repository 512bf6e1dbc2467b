from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from services.training.settings import TrainingSettings


def test_weights_go_into_a_file_that_can_be_loaded(tmp_path: Path) -> None:
    (tmp_path / "folder.pt").mkdir()
    for output in ("my", "my.onnx", tmp_path, tmp_path / "folder.pt"):
        with pytest.raises(ValidationError, match=r"not a file of weights; use a name that ends in \.pt"):
            TrainingSettings.model_validate({"output": output})
    assert TrainingSettings.model_validate({"output": "my.pt"}).output == Path("my.pt")


def test_a_share_of_weights_is_kept_where_there_are_some() -> None:
    with pytest.raises(ValidationError, match="--keep: there are no weights to keep a share of; name them with --from"):
        TrainingSettings(keep=0.5)
    with pytest.raises(ValidationError, match="keep"):
        TrainingSettings.model_validate({"from": "a.pt", "data": ["site"], "keep": 1})


@pytest.mark.parametrize("workers", [0, 1025])
def test_there_is_an_end_to_the_number_of_threads(workers: int) -> None:
    with pytest.raises(ValidationError, match="workers"):
        TrainingSettings(workers=workers)
    assert TrainingSettings(workers=1024).workers == 1024


def test_a_run_that_begins_with_weights_takes_less_unless_told_otherwise() -> None:
    scratch = TrainingSettings()
    given = TrainingSettings.model_validate({"from": "a.pt", "data": ["site"], "refiner_epochs": 3})
    assert (scratch.images, scratch.refiner_images, scratch.refiner_epochs) == (6000, 12000, 5)
    assert (given.images, given.refiner_images, given.refiner_epochs) == (600, 1500, 3)


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"start": None}, "name the weights whose refiner it is with --from"),
        ({"keep": 0.5}, "leave --keep and --class-names out"),
        ({"class_names": {"box": "parcel"}}, "leave --keep and --class-names out"),
        ({"refiner_images": 0}, "nothing to learn from"),
    ],
)
def test_a_refiner_alone_needs_weights_that_stay_as_they_are(more: dict[str, Any], why: str) -> None:
    with pytest.raises(ValidationError, match=f"--only-refiner: .*{why}"):
        TrainingSettings(**{"start": Path("my.pt"), "only_refiner": True, **more})


def test_a_refiner_alone_is_trained_as_long_as_one_from_scratch() -> None:
    alone = TrainingSettings.model_validate({"from": "my.pt", "only_refiner": True})
    assert (alone.refiner_images, alone.refiner_epochs) == (12000, 5)
