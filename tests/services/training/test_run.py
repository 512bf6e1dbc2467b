"""A whole run, as small as it can be: real rendering, real Ultralytics."""

import os
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from services.detector.runtime.refinement.refiner import stretched
from services.simulator.world import CLASSES
from services.toolbox.train.inference import open_weights
from services.toolbox.train.refinement import REFINEMENT as OWN
from services.training.checkpoints import Checkpoint, embedded_paths
from services.training.files import TrainingError
from services.training.refining.refinement import Looks, RefinerLook
from services.training.run import train
from services.training.settings import TrainingSettings
from services.training.stages import TrainingStage, stages_of
from services.training.trainer import load_ultralytics

BATCHES = 2


def open_everywhere(_weights: Path, _device: str, _folder: Path) -> RefinerLook:
    """Look at a picture as if the model had found something of each class in every part of it, however little it knows.

    The masks are full, and the features what is bright.
    """
    places = np.array([(x, y, x + 80, y + 80) for x in range(0, 600, 120) for y in range(0, 440, 120)])

    def look(image: NDArray[np.uint8]) -> Looks:
        squares = np.array([stretched(image[y:below, x:right]) for x, y, right, below in places.tolist()])
        count = len(places)
        labels = np.tile(np.arange(len(CLASSES)), count)
        pixels = np.concatenate([squares, np.full_like(squares, 255)], axis=-1).repeat(len(CLASSES), axis=0)
        masks = np.ones(pixels.shape[:3], np.bool_)
        features = pixels[:, ::2, ::2, :1].astype(np.float16).repeat(32, axis=-1)  # as many as the model has prototypes
        scores = np.full(len(labels), 0.5, np.float32)
        return Looks(pixels, features, labels, scores, places.repeat(len(CLASSES), axis=0), masks, lambda it: it)

    return look


REFINEMENT = replace(OWN, open=open_everywhere)


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

    def totals(self, stage: str) -> set[int]:
        return {total for reported, _, total in self.reports if reported == stage}

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
        refiner_images=4,
        refiner_epochs=2,
        imgsz=64,
        batch=2,
        workers=1,
        device="cpu",
        output=folder / "out" / "tiny-seg.pt",
        work_dir=folder / "work",
    )


def fine(settings: TrainingSettings) -> TrainingStage:
    return stages_of(settings)[-2]


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory: pytest.TempPathFactory) -> TrainingSettings:
    """Stop a run in its second epoch."""
    settings = small(tmp_path_factory.mktemp("training"))
    with pytest.raises(Interrupted):
        train(settings, Recorder(interrupt_at=("train fine", BATCHES + 1)), open_weights, REFINEMENT)
    assert Checkpoint.read(fine(settings).checkpoint(settings.work_dir)).epoch == 0
    assert not settings.output.exists()
    return settings


class Intruder:
    """Makes a folder as it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, (str(self._folder),)


def intrude(settings: TrainingSettings) -> None:
    """Leave in a run's work directory what makes the folder `made` there once Ultralytics reads it."""
    made, work_dir = settings.work_dir / "made", settings.work_dir
    checkpoint = fine(settings).checkpoint(work_dir)
    state = torch.load(checkpoint, weights_only=False)
    state["ema"].yaml["activation"] = f"__import__('os').mkdir({str(made)!r}) or nn.SiLU()"
    torch.save(state, checkpoint)
    torch.save({"epoch": 0, "model": Intruder(made)}, work_dir / "fit-fine" / "weights" / "best.pt")
    for split in ("train", "val"):
        with (work_dir / "data" / "labels" / f"{split}.cache").open("wb") as cache:
            np.save(cache, np.array(Intruder(made), dtype=object))


@pytest.fixture(scope="module")
def resumed(interrupted: TrainingSettings) -> Recorder:
    """Take the run up again, somebody having been at its files, and let it end."""
    recorder = Recorder()
    intrude(interrupted)
    train(interrupted, recorder, open_weights, REFINEMENT)
    return recorder


def test_a_run_goes_on_after_the_last_whole_epoch(resumed: Recorder) -> None:
    assert resumed.of("train coarse") == []
    assert resumed.of("train fine") == [BATCHES + 1, 2 * BATCHES]
    assert resumed.of("train polish") == [1, BATCHES]
    assert resumed.of("render")[-1] == 3
    assert resumed.of("look") == [0, 1, 2]
    assert resumed.of("train refiner")[-1] == resumed.totals("train refiner").pop()
    stage, done, total = resumed.reports[-1]
    assert (stage, done) == ("drive", total)
    assert resumed.of("evaluate") == resumed.of("evaluate unrefined") == [1]


@pytest.mark.usefixtures("resumed")
def test_the_weights_are_a_segmentation_model_in_half_precision(interrupted: TrainingSettings) -> None:
    model = load_ultralytics(interrupted.work_dir / "ultralytics").YOLO(str(interrupted.output))
    assert model.task == "segment"
    assert tuple(model.names.values()) == CLASSES
    assert model.overrides["imgsz"] == 64
    assert model.ckpt["optimizer"] is None
    assert model.ckpt["ema"] is None
    assert {value.dtype for value in model.ckpt["mask_refiner"].values()} == {torch.float16, torch.int64}
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
        "fleetsight train --seed 3 --images 4 --holdout 1 --coarse-epochs 1 --polish-epochs 1 --refiner-images 4 "
        "--refiner-epochs 2 --imgsz 64 --batch 2" in card
    )
    assert re.search(r"trained for 2 epochs on\n  \d{2,} things that the model found in 4 images", card)
    assert "1 epochs at half\n  the size, 2 at the whole and 1 more" in card
    assert "no photograph" in card
    assert str(interrupted.work_dir) not in card
    for name in CLASSES:
        assert card.count(f"| {name} | ") == 3
    for held_out in ("| all | ", "mask mAP50-95", "right in", "seeds 3600000 to 3600000", "device cpu"):
        assert held_out in card


@pytest.fixture(scope="module")
def only_refined(interrupted: TrainingSettings, resumed: Recorder, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train the refiner of the run's weights anew, and nothing else; return the new weights."""
    folder, recorder = tmp_path_factory.mktemp("refining"), Recorder()
    changed = {"output": folder / "refined.pt", "work_dir": folder / "work", "seed": 4}
    settings = interrupted.model_copy(update={**changed, "start": interrupted.output, "only_refiner": True})
    train(settings, recorder, open_weights, REFINEMENT)
    assert {stage for stage, _, _ in recorder.reports} & {"render", "train coarse", "train mixed"} == set()
    assert recorder.totals("train refiner") == resumed.totals("train refiner")
    return settings.output


def test_a_refiner_alone_is_trained_anew_and_the_model_stays(interrupted: TrainingSettings, only_refined: Path) -> None:
    before, after = (Checkpoint.read(file).weights for file in (interrupted.output, only_refined))
    assert before.keys() == after.keys()
    assert all(torch.equal(before[name], after[name]) for name in before)
    states = [REFINEMENT.state_in(file) for file in (interrupted.output, only_refined)]
    assert states[0] is not None
    assert states[1] is not None
    assert not torch.equal(states[0]["out.weight"], states[1]["out.weight"])


def test_the_card_says_that_the_refiner_alone_was_trained(only_refined: Path) -> None:
    card = only_refined.with_suffix(".md").read_text()
    assert "that of tiny-seg.pt but for what refines its masks.\n" in card
    assert "--from tiny-seg.pt --only-refiner" in card
    assert "is on the card of tiny-seg.pt" in card
    assert "trained for 2 epochs on" in card
    for other in ("batch", "no photograph", "trained from"):
        assert other not in card.replace("--batch 2", "")


def test_weights_that_cannot_get_a_refiner_are_named(
    interrupted: TrainingSettings, only_refined: Path, tmp_path: Path
) -> None:
    other = {"start": only_refined, "only_refiner": True, "work_dir": tmp_path / "work"}
    settings = interrupted.model_copy(update=other)
    assert refusal(settings.model_copy(update={"imgsz": 96})) == (
        "--imgsz 96: the weights of --from are for 64; give --imgsz 64"
    )
    bins, boxes = tmp_path / "bins.pt", tmp_path / "boxes.pt"
    Checkpoint.read(only_refined).with_classes(["box", "bin"], {}).write(bins, {})
    assert refusal(settings.model_copy(update={"start": bins})) == (
        "--only-refiner: the classes are box, bin; it learns from box, pallet, forklift alone"
    )
    ultralytics = load_ultralytics(tmp_path / "ultralytics")
    ultralytics.YOLO("yolo11n.yaml").save(str(boxes))
    assert refusal(settings.model_copy(update={"start": boxes})) == (
        f"--only-refiner: {boxes} finds boxes, and no masks that could be refined"
    )


@pytest.mark.usefixtures("resumed")
def test_a_run_that_is_done_is_not_trained_again(interrupted: TrainingSettings) -> None:
    recorder = Recorder(interrupt_at=("evaluate", 1))
    with pytest.raises(Interrupted):
        train(interrupted, recorder, open_weights, REFINEMENT)
    assert recorder.of("train coarse") == recorder.of("train fine") == recorder.of("train refiner") == []


def test_a_work_directory_belongs_to_one_set_of_settings(interrupted: TrainingSettings, tmp_path: Path) -> None:
    other = interrupted.model_copy(update={"seed": 4})
    reason = "holds a run with other settings; choose another or remove it"
    assert refusal(other) == f"--work-dir {interrupted.work_dir}: {reason}"
    assert "--device nonsense: " in refusal(other.model_copy(update={"device": "nonsense"}))
    (tmp_path / "file").touch()
    assert "--output " in refusal(other.model_copy(update={"output": tmp_path / "file" / "my.pt"}))


def test_a_work_directory_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for work_dir, reason in ((tmp_path / "file", "File exists"), (tmp_path / "file" / "more", "Not a directory")):
        settings = small(tmp_path).model_copy(update={"work_dir": work_dir})
        assert refusal(settings) == f"--work-dir {work_dir}: {reason}"
    note = tmp_path / "work" / "settings.json"
    note.mkdir(parents=True)
    assert refusal(small(tmp_path)) == f"{note}: Is a directory"


def refusal(settings: TrainingSettings) -> str:
    """Return why a run does not begin."""
    recorder = Recorder()
    with pytest.raises(TrainingError) as refused:
        train(settings, recorder, open_weights, REFINEMENT)
    assert recorder.reports == []
    return str(refused.value)


def test_what_cannot_work_is_said_before_anything_is_rendered(tmp_path: Path) -> None:
    assert "--device nonsense: " in refusal(small(tmp_path / "a").model_copy(update={"device": "nonsense"}))
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "out").write_text("a file where a folder should be")
    assert "tiny-seg.pt: File exists" in refusal(small(tmp_path / "b"))
    (tmp_path / "c" / "work").mkdir(parents=True)
    fine(small(tmp_path / "c")).checkpoint(tmp_path / "c" / "work").write_bytes(b"no checkpoint")
    assert "fine.pt: not a checkpoint (" in refusal(small(tmp_path / "c"))
    (tmp_path / "d" / "work").mkdir(parents=True)
    (tmp_path / "d" / "work" / "refiner.pt").write_bytes(b"no checkpoint")
    assert "refiner.pt: not a checkpoint of a refiner (" in refusal(small(tmp_path / "d"))


@pytest.mark.usefixtures("resumed")
def test_nothing_in_the_work_directory_is_executed_when_a_run_goes_on(interrupted: TrainingSettings) -> None:
    assert not (interrupted.work_dir / "made").exists()


def test_a_checkpoint_that_is_more_than_a_network_is_not_unpickled(tmp_path: Path) -> None:
    made, settings = tmp_path / "made", small(tmp_path)
    settings.work_dir.mkdir(parents=True)
    torch.save({"epoch": 0, "model": Intruder(made)}, fine(settings).checkpoint(settings.work_dir))
    assert "fine.pt: not a checkpoint (it calls for posix.mkdir" in refusal(settings)
    assert not made.exists()
