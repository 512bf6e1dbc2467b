"""A run for other classes than the simulator's: some new, some by another name, or none of them; and its early end."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from services.detector.settings import SHIPPED_MODEL
from services.simulator.world import CLASSES
from services.toolbox.train.inference import open_weights
from services.toolbox.train.refinement import REFINEMENT
from services.training.checkpoints import CLASS_ROWS, Checkpoint
from services.training.files import TrainingError
from services.training.run import train
from services.training.settings import TrainingSettings
from services.training.stages import BestEpoch, stages_of
from services.training.trainer import load_ultralytics
from tests.services.training.test_fine_tuning import (
    PICTURES,
    Interrupted,
    photographs,
    settings_for,
    stopped_before_training,
)


def folder_with(folder: Path, *names: str) -> Path:
    """Make photographs whose classes have these names, the first three what the simulator has."""
    data = photographs(folder)
    (data / "incomplete.txt").unlink()
    (data / "data.yaml").write_text(yaml.safe_dump({"names": dict(enumerate(names))}))
    return data


def trained(settings: TrainingSettings) -> tuple[Checkpoint, str, set[str]]:
    """Train; return the weights, the card and the stages that were reported."""
    reported = set[str]()
    train(settings, lambda stage, *_: reported.add(stage), open_weights, REFINEMENT)
    return Checkpoint.read(settings.output), settings.output.with_suffix(".md").read_text(), reported


def test_a_class_gets_another_name_and_a_new_one_comes_in(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "services.training")
    data = folder_with(tmp_path / "data", "parcel", "pallet", "forklift", "tote")
    given = {"from": SHIPPED_MODEL, "data": [data], "class_names": {"box": "parcel"}, "data_rate": 1e-5, "freeze": 11}
    given["patience"] = 1
    settings = settings_for(tmp_path, **given, refiner_images=4)
    weights, card, reported = trained(settings)
    assert weights.classes == ("parcel", "pallet", "forklift", "tote")
    assert "classes: parcel, pallet, forklift, tote; new: tote" in caplog.messages
    before = Checkpoint.read(SHIPPED_MODEL).weights
    for name, tensor in weights.weights.items():
        if CLASS_ROWS.fullmatch(name):
            assert tensor[:3].sub(before[name]).abs().max() < 0.01, "parcels are known as boxes were"
            assert len(tensor) == 4
        elif name.startswith("model.0.") and name.endswith("weight"):
            assert tensor.equal(before[name]), "it was to stay as it is"
    rendered = (tmp_path / "work/data/labels/train").glob("*.txt")
    assert {line[0] for file in rendered for line in file.read_text().splitlines()} <= set("012")
    assert card.startswith("# site-seg: parcel, pallet, forklift, tote\n")
    assert "--from warehouse-n-seg.pt --class-names box=parcel --freeze 11" in card
    assert f"| rendered | {PICTURES} | parcel |" in card
    assert "On scenes that it was not trained on" in card
    assert "made finer" not in card, "what refines masks knows the simulator's classes alone"
    assert {"judge", "evaluate", "drive", "photographs"} <= reported
    assert "<td>parcel</td>" in settings.output.with_suffix(".html").read_text(encoding="utf-8")


@pytest.mark.parametrize("architecture", ["yolo11n", "yolo26n"])
def test_a_model_for_boxes_learns_classes_that_the_simulator_does_not_have_and_stops_early(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, architecture: str
) -> None:
    start = tmp_path / "start.pt"
    load_ultralytics(tmp_path / "ultralytics").YOLO(f"{architecture}.yaml").save(start)
    data = folder_with(tmp_path / "data", "tote", "cage", "crate")
    settings = settings_for(tmp_path, **{"from": start, "data": [data], "data_epochs": 4, "patience": 1})
    monkeypatch.setattr("services.training.run.judge_on", lambda *_: lambda _: 0.5)
    caplog.set_level("INFO", "services.training")
    weights, card, reported = trained(settings)
    (told,) = caplog.messages
    assert told.startswith(
        "classes: tote, cage, crate; new: tote, cage, crate; left out, as no data.yaml names them: 0, "
    )
    assert (weights.classes, weights.task) == (("tote", "cage", "crate"), "detect")
    (stage,) = stages_of(settings)
    checkpoint = stage.checkpoint(settings.work_dir)
    best = BestEpoch(checkpoint, 1, lambda _: 0.0)
    assert best.waited_enough
    assert (Checkpoint.read(best.checkpoint).epoch, Checkpoint.read(checkpoint).epoch) == (0, 1)
    listed = (settings.work_dir / "mix/train.txt").read_text().splitlines()
    assert {Path(line).suffix for line in listed} == {".jpg"}, "the simulator's pictures have nothing to teach"
    assert "photographs" in reported
    assert "evaluate" not in reported
    assert f"A model for detection (`{architecture}.yaml`, 3 classes" in card
    assert "On scenes that it was not trained on" not in card
    assert "--patience 1" in card


def test_boxes_alone_of_the_simulator_s_classes_have_no_masks_to_refine(tmp_path: Path) -> None:
    start = tmp_path / "start.pt"
    load_ultralytics(tmp_path / "ultralytics").YOLO("yolo11n.yaml").save(start)
    data = photographs(tmp_path / "data")
    settings = settings_for(tmp_path, **{"from": start, "data": [data], "data_epochs": 1, "refiner_images": 4})
    weights, _, _ = trained(settings)
    assert (weights.classes, weights.task) == (CLASSES, "detect")


def test_another_run_s_classes_are_not_taken_for_this_one_s(tmp_path: Path) -> None:
    data = folder_with(tmp_path / "data", "box", "pallet", "forklift", "tote: blue")
    settings = settings_for(tmp_path, **{"from": SHIPPED_MODEL, "data": [data]})
    with pytest.raises(Interrupted):
        train(settings, stopped_before_training, open_weights, REFINEMENT)
    assert yaml.safe_load((settings.work_dir / "data/dataset.yaml").read_text())["names"][3] == "tote: blue"
    (data / "data.yaml").write_text("names: [tote, box, pallet, forklift]")
    with pytest.raises(TrainingError, match="holds a run with other settings"):
        train(settings, lambda *_: None, open_weights, REFINEMENT)


def test_no_epoch_is_waited_for_before_anything_was_found(tmp_path: Path) -> None:
    checkpoint, figures = tmp_path / "mixed.pt", iter((0.0, 0.0, 0.0, 0.1, 0.0, 0.0))
    for epoch in range(6):
        checkpoint.write_bytes(str(epoch).encode())
        best = BestEpoch(checkpoint, 2, lambda _: next(figures))
        best.catch_up(epoch)
        best.catch_up(epoch)
        assert best.checkpoint.read_bytes() == str(min(epoch, 3)).encode()
        assert best.waited_enough == (epoch == 5)


def test_an_interrupted_run_goes_on_with_its_best_epoch(tmp_path: Path) -> None:
    checkpoint, figures = tmp_path / "mixed.pt", iter((0.4, 0.6, 0.6, 0.5, 0.7))
    checkpoint.write_bytes(b"")

    def judge(latest: Path) -> float:
        return next(figures) if latest == checkpoint else -1

    for epoch in range(5):
        checkpoint.write_bytes(str(epoch).encode())
        best = BestEpoch(checkpoint, 3, judge)  # as after an interruption
        best.add(epoch)
        assert best.checkpoint.read_bytes() == (b"0", b"1", b"1", b"1", b"4")[epoch]
        assert not best.waited_enough
    assert BestEpoch(checkpoint, 0, judge).waited_enough
    (tmp_path / "mixed-best.json").write_text("?")
    with pytest.raises(TrainingError, match=r"mixed-best\.json: not a record of a run; remove it"):
        BestEpoch(checkpoint, 3, judge)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"class_names": {"crate": "tote"}}, "no class 'crate'; there are box, pallet, forklift"),
        ({"class_names": {"box": "crate"}}, "--class-names box=crate: no data.yaml names 'crate'; those do tote"),
        ({"class_names": {"box": "tote", "pallet": "tote"}}, "--class-names: 2 classes would be 'tote'; give each"),
        ({"from": None}, "the simulator has none of tote: name weights to begin with by --from"),
    ],
)
def test_classes_that_nothing_can_be_learned_of_are_refused(tmp_path: Path, more: dict[str, Any], message: str) -> None:
    data = folder_with(tmp_path / "data", "tote")
    for labels in (data / "val/labels").iterdir():
        labels.write_text("0 0.1 0.1 0.5 0.1 0.5 0.5\n")
    settings = settings_for(tmp_path, **{"from": SHIPPED_MODEL, "data": [data], **more})
    with pytest.raises(TrainingError, match=message):
        train(settings, lambda *_: None, open_weights, REFINEMENT)
    assert not (settings.work_dir / "settings.json").exists(), "with the mistake mended it is to run"


def test_patience_needs_something_to_be_found(tmp_path: Path) -> None:
    data = folder_with(tmp_path / "data", "tote")
    for labels in (data / "val/labels").iterdir():
        labels.write_text("")
    settings = settings_for(tmp_path, **{"from": SHIPPED_MODEL, "data": [data], "patience": 2})
    with pytest.raises(TrainingError, match="--patience: no object in the pictures of val or test"):
        train(settings, lambda *_: None, open_weights, REFINEMENT)


@pytest.mark.parametrize("architecture", ["yolo11n-pose", "yolo26n-seg"])
def test_a_model_whose_last_layer_is_another_is_refused(tmp_path: Path, architecture: str) -> None:
    start = tmp_path / "start.pt"
    load_ultralytics(tmp_path / "ultralytics").YOLO(f"{architecture}.yaml").save(start)
    settings = settings_for(tmp_path, **{"from": start, "data": [photographs(tmp_path / "data")]})
    with pytest.raises(TrainingError, match=r"start\.pt: not a checkpoint"):
        train(settings, lambda *_: None, open_weights, REFINEMENT)
