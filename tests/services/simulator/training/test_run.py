"""A whole run, as small as it can be: real rendering, real Ultralytics."""

import zipfile
from pathlib import Path

import pytest

from services.simulator.training.engine import load_ultralytics
from services.simulator.training.errors import TrainingError
from services.simulator.training.fitting import epochs_done
from services.simulator.training.run import train
from services.simulator.training.settings import TrainingSettings
from services.simulator.training.stages import Stage, stages_of
from services.simulator.training.weights import embedded_paths
from services.simulator.world import CLASSES
from services.toolbox.train.inference import open_weights

BATCHES = 2


class Interrupted(Exception):  # noqa: N818 - what an interruption is, not an error
    """Stops a run from within its progress report."""


class Recorder:
    """Keeps what is reported, and interrupts the run at a given report."""

    def __init__(self, interrupt_at: tuple[str, int] | None = None) -> None:
        self.reports: list[tuple[str, int, int]] = []
        self._interrupt_at = interrupt_at

    def __call__(self, stage: str, done: int, total: int) -> None:
        self.reports.append((stage, done, total))
        if (stage, done) == self._interrupt_at:
            raise Interrupted

    def of(self, stage: str) -> list[int]:
        return [done for reported, done, _ in self.reports if reported == stage]


def small(folder: Path) -> TrainingSettings:
    return TrainingSettings(
        seed=3,
        images=4,
        holdout=1,
        coarse_epochs=1,
        epochs=2,
        polish_epochs=1,
        imgsz=64,
        batch=2,
        workers=1,
        device="cpu",
        output=folder / "out" / "tiny-seg.pt",
        work_dir=folder / "work",
    )


def fine(settings: TrainingSettings) -> Stage:
    return stages_of(settings)[-2]


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory: pytest.TempPathFactory) -> TrainingSettings:
    """Stop a run in its second epoch."""
    settings = small(tmp_path_factory.mktemp("training"))
    with pytest.raises(Interrupted):
        train(settings, Recorder(interrupt_at=("train fine", BATCHES + 1)), open_weights)
    assert epochs_done(fine(settings).checkpoint(settings.work_dir)) == 1
    assert not settings.output.exists()
    return settings


@pytest.fixture(scope="module")
def resumed(interrupted: TrainingSettings) -> Recorder:
    """Take the run up again and let it end."""
    recorder = Recorder()
    train(interrupted, recorder, open_weights)
    return recorder


def test_a_run_goes_on_after_the_last_whole_epoch(resumed: Recorder) -> None:
    assert resumed.of("train coarse") == []
    assert resumed.of("train fine") == [BATCHES + 1, 2 * BATCHES]
    assert resumed.of("train polish") == [1, BATCHES]
    assert resumed.of("render")[-1] == 3
    stage, done, total = resumed.reports[-1]
    assert (stage, done) == ("drive", total)
    assert resumed.of("evaluate") == [1]


@pytest.mark.usefixtures("resumed")
def test_the_weights_are_a_segmentation_model_in_half_precision(interrupted: TrainingSettings) -> None:
    model = load_ultralytics(interrupted.work_dir / "ultralytics").YOLO(str(interrupted.output))
    assert model.task == "segment"
    assert tuple(model.names.values()) == CLASSES
    assert model.overrides["imgsz"] == 64
    assert model.ckpt["optimizer"] is None
    assert model.ckpt["ema"] is None
    assert interrupted.output.stat().st_size < 8_000_000


@pytest.mark.usefixtures("resumed")
def test_nothing_in_the_weights_says_where_they_were_made(interrupted: TrainingSettings) -> None:
    assert embedded_paths(interrupted.output.read_bytes()) == []
    assert embedded_paths(fine(interrupted).checkpoint(interrupted.work_dir).read_bytes()) != []
    with zipfile.ZipFile(interrupted.output) as archive:
        content = b"".join(archive.read(name) for name in archive.namelist() if "/data/" not in name)
    for word in (interrupted.work_dir.parent.name, "dataset.yaml", "branch", "commit", "save_dir"):
        assert word.encode() not in content


@pytest.mark.usefixtures("resumed")
def test_the_card_says_how_it_was_made(interrupted: TrainingSettings) -> None:
    card = interrupted.output.with_suffix(".md").read_text()
    assert (
        "fleetsight train --seed 3 --images 4 --holdout 1 --coarse-epochs 1 --polish-epochs 1 --imgsz 64 --batch 2"
        in card
    )
    assert "1 epochs at half\n  the size, 2 at the whole and 1 more" in card
    assert "no photograph" in card
    assert str(interrupted.work_dir) not in card
    for name in CLASSES:
        assert card.count(f"| {name} | ") == 3
    for held_out in ("| all | ", "mask mAP50-95", "right in", "seeds 3600000 to 3600000", "device cpu"):
        assert held_out in card


@pytest.mark.usefixtures("resumed")
def test_a_run_that_is_done_is_not_trained_again(interrupted: TrainingSettings) -> None:
    recorder = Recorder(interrupt_at=("evaluate", 1))
    with pytest.raises(Interrupted):
        train(interrupted, recorder, open_weights)
    assert recorder.of("train coarse") == recorder.of("train fine") == []


def test_a_work_directory_belongs_to_one_set_of_settings(interrupted: TrainingSettings) -> None:
    with pytest.raises(TrainingError, match="other settings"):
        train(interrupted.model_copy(update={"seed": 4}), Recorder(), open_weights)


def refusal(settings: TrainingSettings) -> str:
    """Return why a run does not begin."""
    recorder = Recorder()
    with pytest.raises(TrainingError) as refused:
        train(settings, recorder, open_weights)
    assert recorder.reports == []
    return str(refused.value)


def test_what_cannot_work_is_said_before_anything_is_rendered(tmp_path: Path) -> None:
    assert "--device nonsense: " in refusal(small(tmp_path / "a").model_copy(update={"device": "nonsense"}))
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "out").write_text("a file where a folder should be")
    assert "tiny-seg.pt: File exists" in refusal(small(tmp_path / "b"))
    (tmp_path / "c" / "work").mkdir(parents=True)
    fine(small(tmp_path / "c")).checkpoint(tmp_path / "c" / "work").write_bytes(b"no checkpoint")
    assert "fine.pt is no checkpoint, remove it: " in refusal(small(tmp_path / "c"))
