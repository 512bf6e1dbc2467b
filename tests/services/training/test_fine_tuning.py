"""A run that begins with given weights, on photographs and rendered pictures: real rendering, real Ultralytics."""

from pathlib import Path

import pytest
import torch
from pydantic import ValidationError

from benchmarks.photographs.stand_ins import write_stand_ins
from services.detector.settings import SHIPPED_MODEL
from services.toolbox.train.inference import open_weights
from services.toolbox.train.refinement import REFINEMENT
from services.training.checkpoints import Checkpoint
from services.training.files import TrainingError
from services.training.run import train
from services.training.settings import TrainingSettings
from services.training.stages import stages_of

PICTURES = 6


def photographs(folder: Path) -> Path:
    """Make a folder whose pictures to train on, and to test on, are the same few; one of them has boxes alone."""
    write_stand_ins(folder)
    (folder / "train").symlink_to(folder / "val", target_is_directory=True)
    (folder / "incomplete.txt").write_text("rendered\tlabelled=box,forklift\tabsent=\tunknown=pallet\n")
    (folder / "boxes_only.txt").write_text("rendered_0.jpg\n")
    (folder / "licences.txt").write_text("rendered\tAGPL-3.0\tmade here\n")
    return folder


def settings_for(folder: Path, **more: object) -> TrainingSettings:
    sizes = {"images": 2, "holdout": 1, "refiner_images": 0, "imgsz": 64, "batch": 4, "workers": 1, "data_epochs": 2}
    sizes["collages"] = 8
    paths = {"output": folder / "out" / "site-seg.pt", "work_dir": folder / "work"}
    return TrainingSettings.model_validate({"seed": 4, "device": "cpu", **sizes, **paths, **more})


class Interrupted(Exception):  # noqa: N818 - what an interruption is, not an error
    """Stops a run from within its progress report."""


def stopped_before_training(stage: str, _done: int, _total: int) -> None:
    """Report progress of a run until its data are made."""
    if stage.startswith("train"):
        raise Interrupted


def test_a_run_begins_with_given_weights_and_goes_on_after_an_interruption(tmp_path: Path) -> None:
    given = {"from": SHIPPED_MODEL, "data": [photographs(tmp_path / "data")], "keep": 0.5, "data_rate": 1e-3}
    settings = settings_for(tmp_path, **given)
    (stage,) = stages_of(settings)
    reports: list[tuple[str, int, int]] = []

    def interrupt(name: str, done: int, total: int) -> None:
        if name == "train mixed" and done > total // 2:
            raise Interrupted

    with pytest.raises(Interrupted):
        train(settings, interrupt, open_weights, REFINEMENT)
    checkpoint = Checkpoint.read(stage.checkpoint(settings.work_dir))
    assert checkpoint.epoch == 0
    train(settings, lambda *report: reports.append(report), open_weights, REFINEMENT)

    batches = [done for name, done, _ in reports if name == "train mixed"]
    assert batches == list(range(batches[0], 2 * (batches[0] - 1) + 1))
    assert ("photographs", PICTURES, PICTURES) in reports
    before, after = (Checkpoint.read(file).weights for file in (SHIPPED_MODEL, settings.output))
    assert before.keys() == after.keys()
    moved = [name for name in before if not before[name].equal(after[name])]
    assert moved
    assert all((before[name] - after[name]).abs().max() < 1 for name in moved if name.endswith("conv.weight"))

    trained = Checkpoint.read(stage.checkpoint(settings.work_dir)).weights
    for name in moved:
        if before[name].is_floating_point():  # in half precision
            torch.testing.assert_close(after[name], (before[name] + trained[name]) / 2, rtol=2e-3, atol=1e-4)

    card = settings.output.with_suffix(".md").read_text()
    assert "from warehouse-n-seg.pt on rendered pictures of simulated warehouses and on photographs" in card
    assert "--data data --data-epochs 2 --collages 8 --data-rate 0.001 --from warehouse-n-seg.pt --keep 0.5" in card
    assert "with a share of 0.50, of those that the run began with" in card
    assert "- `rendered`: AGPL-3.0: made here" in card
    assert "Among them are 0 pictures made of the photographs" in card, "none of these is without objects"
    assert "and 1 plain, empty ones" in card
    assert max(file.name for file in (settings.work_dir / "made").iterdir()) == "plain_00000.jpg"
    assert f"| rendered | {PICTURES} | box |" in card
    assert f"| rendered | {PICTURES} | pallet |" not in card
    assert str(tmp_path) not in card
    page = settings.output.with_suffix(".html").read_text(encoding="utf-8")
    assert f"<h1>{settings.output.stem}: mistakes on photographs</h1>" in page
    assert '<th scope="row">rendered</th><td>box</td>' in page


def test_few_photographs_do_not_drown_in_plain_pictures(tmp_path: Path) -> None:
    given = {"from": SHIPPED_MODEL, "data": [photographs(tmp_path / "data")], "collages": 300}
    settings = settings_for(tmp_path, **given)
    with pytest.raises(Interrupted):
        train(settings, stopped_before_training, open_weights, REFINEMENT)
    assert [file.name for file in (settings.work_dir / "made").iterdir()] == ["plain_00000.jpg"]


def test_photographs_are_the_last_stage_of_a_run_from_scratch(tmp_path: Path) -> None:
    settings = settings_for(tmp_path, data=[tmp_path], data_epochs=3, data_rate=1e-4)
    assert [stage.name for stage in stages_of(settings)] == ["coarse", "fine", "polish", "mixed"]
    assert [stage.mixed for stage in stages_of(settings)] == [False, False, False, True]
    assert stages_of(settings)[-1].imgsz == settings.imgsz, "at half of it, photographs as a detector sees them are new"
    assert stages_of(settings)[-1].first_rate == 1e-4
    assert stages_of(settings)[-1].last_rate == pytest.approx(2e-6)


def test_weights_without_photographs_have_nothing_to_learn() -> None:
    with pytest.raises(ValidationError, match="name a folder of photographs with --data"):
        TrainingSettings.model_validate({"from": SHIPPED_MODEL})


def test_a_folder_without_photographs_is_named_before_anything_is_rendered(tmp_path: Path) -> None:
    settings = settings_for(tmp_path, data=[tmp_path / "nothing"])
    with pytest.raises(TrainingError, match="nothing: no pictures in train/images"):
        train(settings, lambda *_: None, open_weights, REFINEMENT)
    assert not (settings.work_dir / "data").exists()


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("licences.txt", "rendered AGPL-3.0", r"licences\.txt: not a source"),
        ("val/labels/rendered_1.txt", "0 0.1", r"rendered_1\.txt, line 1"),
        ("val/images/rendered_1.jpg", "no picture", r"rendered_1\.jpg: not a picture"),
    ],
)
def test_what_only_the_evaluation_needs_is_read_before_anything_is_rendered(
    tmp_path: Path, file: str, content: str, message: str
) -> None:
    folder = photographs(tmp_path / "data")
    (folder / file).write_text(content)
    settings = settings_for(tmp_path, data=[folder])
    with pytest.raises(TrainingError, match=message):
        train(settings, lambda *_: None, open_weights, REFINEMENT)
    assert not (settings.work_dir / "data").exists()


def test_photographs_to_train_on_alone_are_not_enough(tmp_path: Path) -> None:
    folder = photographs(tmp_path / "data")
    (folder / "train").unlink()
    (folder / "val").rename(folder / "train")
    settings = settings_for(tmp_path, data=[folder])
    with pytest.raises(TrainingError, match="data: no pictures in val/images or test/images"):
        train(settings, lambda *_: None, open_weights, REFINEMENT)
    assert not (settings.work_dir / "data").exists()


def test_weights_that_cannot_be_read_are_named_before_anything_is_rendered(tmp_path: Path) -> None:
    garbage = tmp_path / "garbage.pt"
    garbage.write_bytes(b"nothing of the kind")
    settings = settings_for(tmp_path, **{"from": garbage, "data": [photographs(tmp_path / "data")]})
    with pytest.raises(TrainingError, match=r"garbage\.pt: not a checkpoint"):
        train(settings, lambda *_: None, open_weights, REFINEMENT)
    assert not (settings.work_dir / "data").exists()
