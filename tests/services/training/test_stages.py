from pathlib import Path

import pytest

from services.training.settings import TrainingSettings
from services.training.stages import TrainingStage, stages_of


def test_small_pictures_come_first_unless_there_are_no_passes_for_them() -> None:
    coarse, fine, polish = stages_of(TrainingSettings(coarse_epochs=2, epochs=3, polish_epochs=4, imgsz=640))
    assert (coarse.name, coarse.imgsz, coarse.epochs) == ("coarse", 320, 2)
    assert (fine.name, fine.imgsz, fine.epochs) == ("fine", 640, 3)
    assert (polish.name, polish.imgsz, polish.epochs) == ("polish", 640, 4)
    assert stages_of(TrainingSettings(coarse_epochs=0, epochs=3, polish_epochs=0)) == (fine,)


@pytest.mark.parametrize(("imgsz", "half"), [(640, 320), (96, 64), (32, 32)])
def test_half_the_size_is_one_that_the_model_takes(imgsz: int, half: int) -> None:
    assert stages_of(TrainingSettings(imgsz=imgsz))[0].imgsz == half


def test_each_stage_has_a_checkpoint_of_its_own() -> None:
    names = {stage.checkpoint(Path("w")) for stage in stages_of(TrainingSettings())}
    assert names == {Path("w/coarse.pt"), Path("w/fine.pt"), Path("w/polish.pt")}


@pytest.mark.parametrize(("epochs", "share"), [(0, 1), (1, 1), (2, 0.51), (3, 0.02), (4, 0.02)])
def test_the_rate_holds_and_then_falls_to_its_last(epochs: float, share: float) -> None:
    stage = TrainingStage("fine", 640, 3, first_rate=1e-3, last_rate=2e-5, hold=1)
    assert stage.rate(epochs) == pytest.approx(share)


def test_a_stage_that_is_all_hold_never_falls() -> None:
    assert TrainingStage("fine", 640, 1, first_rate=1e-3, last_rate=2e-5, hold=1).rate(1) == 1
