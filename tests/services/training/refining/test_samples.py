import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from services.detector.runtime.refinement.refiner import SIDE, stretched
from services.simulator.world import CLASSES, Camera, Drive, SeenObject, generate, render, truth_of
from services.training.dataset import VIEWS, holdout_seed, pictures_of, training_seed
from services.training.files import TrainingError
from services.training.refining.refinement import Looks, Refinement, RefinerLook
from services.training.refining.samples import Samples, matched, refining_seeds, write_samples

Picture = NDArray[np.uint8]
WINDOW = 40
BRIGHT = 0.0


def ignored(_stage: str, _done: int, _total: int) -> None:
    """Take progress reports."""


@pytest.fixture(scope="module")
def truths() -> tuple[SeenObject, ...]:
    """See what is on a drive through a scene."""
    scene = generate(700)
    pose, camera = Drive.plan(scene).pose(0.8), Camera()
    return truth_of(scene, render(scene, pose, camera), pose, camera)


def found(truth: SeenObject, **other: int) -> Looks:
    """Return what a perfect model would show of an object, or of its place as something else."""
    rows, columns = truth.mask.shape
    window = np.array([[truth.left, truth.top, truth.left + columns, truth.top + rows]])
    mask = stretched(np.where(truth.mask, np.uint8(255), np.uint8(0))) > 127
    label = other.get("label", CLASSES.index(truth.name))
    pixels = np.full((1, SIDE, SIDE, 6), label, np.uint8)
    features, score = np.zeros((1, 32, 32, 4), np.float16), np.array([0.75], np.float32)
    return Looks(pixels, features, np.array([label]), score, window, mask[None], lambda whole: whole)


def clear(truths: tuple[SeenObject, ...]) -> SeenObject:
    """Return the largest object that is all in view."""
    return max((each for each in truths if each.visibility > 0.9), key=lambda each: each.pixels)


def test_a_close_up_of_an_object_is_learned_with_its_true_mask(truths: tuple[SeenObject, ...]) -> None:
    truth = clear(truths)
    samples = matched(found(truth), truths, stretched)
    assert samples["labels"].tolist() == [CLASSES.index(truth.name)]
    assert samples["scores"].tolist() == [0.75]
    assert np.array_equal(samples["targets"][0], stretched(np.where(truth.mask, np.uint8(255), np.uint8(0))))
    assert samples["features"].shape == (1, 32, 32, 4)


def test_what_is_of_another_class_or_none_is_learned_to_be_nothing(truths: tuple[SeenObject, ...]) -> None:
    truth = clear(truths)
    other = (CLASSES.index(truth.name) + 1) % len(CLASSES)
    for samples in (matched(found(truth, label=other), (truth,), stretched), matched(found(truth), (), stretched)):
        assert len(samples) == 1
        assert not samples["targets"].any()


def test_what_is_mostly_hidden_is_not_learned(truths: tuple[SeenObject, ...]) -> None:
    hidden = min((each for each in truths if each.image_share > 0.001), key=lambda each: each.visibility)
    assert hidden.visibility < 0.3
    assert not len(matched(found(hidden), truths, stretched))


def test_what_may_be_an_object_or_not_is_not_learned(truths: tuple[SeenObject, ...]) -> None:
    truth = clear(truths)
    whole = found(truth)
    for share, learned in ((0.05, 1), (0.2, 0), (0.5, 1)):
        part = whole.masks & (np.cumsum(whole.masks).reshape(whole.masks.shape) <= share * whole.masks.sum())
        assert len(matched(dataclasses.replace(whole, masks=part), truths, stretched)) == learned


def test_the_object_is_the_one_that_the_coarse_mask_is_of(truths: tuple[SeenObject, ...]) -> None:
    boxes = [each for each in truths if each.name == "box" and each.visibility > 0.9 and each.image_share > 0.001]
    assert len(boxes) > 2
    for truth in boxes:
        (target,) = matched(found(truth), truths, stretched)["targets"]
        assert np.array_equal(target > 127, found(truth).masks[0])


def open_corner(_weights: Path, device: str, folder: Path) -> RefinerLook:
    """Look at the upper left corner of every picture, and note that."""
    assert device == "cpu"

    def look(image: Picture) -> Looks:
        with (folder / "looks").open("a") as log:
            log.write(f"{image.shape}\n")
        window = image[:WINDOW, :WINDOW, :1]
        pixels, features = (
            np.repeat(stretched(window)[None, ..., None], 6, axis=-1),
            np.ones((1, 32, 32, 2), np.float16),
        )
        score, place = np.ones(1, np.float32), np.array([[0, 0, WINDOW, WINDOW]])
        return Looks(pixels, features, np.array([0]), score, place, np.ones((1, SIDE, SIDE), bool), lambda whole: whole)

    return look


def nothing(*_: object) -> dict[str, object]:
    raise AssertionError


REFINEMENT = Refinement(open_corner, nothing, stretched, nothing, nothing)  # type: ignore[arg-type]


@pytest.fixture
def write(tmp_path: Path) -> Callable[[list[int]], list[Path]]:
    return lambda seeds: write_samples(
        tmp_path, REFINEMENT, Path("x.pt"), seeds, device="cpu", workers=1, progress=ignored
    )


def test_each_scene_is_looked_at_once(write: Callable[[list[int]], list[Path]], tmp_path: Path) -> None:
    files = write([700, 701])
    assert (tmp_path / "looks").read_text().splitlines() == ["(480, 640, 3)"] * (2 * VIEWS)
    assert write([700, 701, 702])[:2] == files
    assert len((tmp_path / "looks").read_text().splitlines()) == 3 * VIEWS


def open_bright(_weights: Path, _device: str, _folder: Path) -> RefinerLook:
    """See everything in a picture that is brighter than most, else nothing of any shape."""

    def look(image: Picture) -> Looks:
        count = int(image.mean() > BRIGHT)
        shape = (count, 32, 32, 2 * count)
        return Looks(
            np.ones((count, SIDE, SIDE, 6), np.uint8),
            np.ones(shape, np.float16),
            np.zeros(count, np.int64),
            np.ones(count, np.float32),
            np.tile(np.array([0, 0, WINDOW, WINDOW]), (count, 1)),
            np.zeros((count, SIDE, SIDE), bool),
            lambda whole: whole,
        )

    return look


@pytest.mark.parametrize("bright", [0, 1, 2])
def test_pictures_in_which_nothing_is_found_are_none_of_the_samples(
    tmp_path: Path, bright: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    means = sorted(float(image.mean()) for image, _ in pictures_of(700, VIEWS))
    limit = [means[1] + 1, means[0], means[0] - 1][bright]
    monkeypatch.setattr("tests.services.training.refining.test_samples.BRIGHT", limit)
    refinement = dataclasses.replace(REFINEMENT, open=open_bright)
    files = write_samples(tmp_path, refinement, Path("x.pt"), [700], device="cpu", workers=1, progress=ignored)
    assert len(Samples(files).labels) == bright


def test_what_cannot_be_written_is_named(tmp_path: Path, write: Callable[[list[int]], list[Path]]) -> None:
    (tmp_path / "000000700.part").symlink_to("/dev/full")
    with pytest.raises(TrainingError, match=r"000000700\.npy: No space left on device"):
        write([700])


def test_samples_are_read_from_their_files(tmp_path: Path) -> None:
    kind = np.dtype([("labels", np.int64), ("targets", np.uint8, (2, 2))])
    every, files = np.zeros(7, kind), [tmp_path / f"{n}.npy" for n in range(4)]
    every["labels"] = [2, 0, 1, 1, 0, 2, 0]
    every["targets"] = np.arange(28).reshape(7, 2, 2)
    for part, file in zip(np.split(every, [3, 3, 5]), files, strict=True):
        np.save(file, part)
    samples = Samples(files)
    assert samples.labels.tolist() == [2, 0, 1, 1, 0, 2, 0]
    for chosen in ([0], [6, 3, 3, 0], [*range(7)]):
        assert np.array_equal(samples.take(np.array(chosen)), every[chosen])


def test_of_no_files_there_are_no_samples() -> None:
    assert not len(Samples([]).labels)


def test_scenes_to_refine_in_are_no_others_scenes() -> None:
    seeds = refining_seeds(1, 6001, 3)
    assert seeds == [training_seed(1, 3001), training_seed(1, 3002)]
    assert holdout_seed(1, 0) > seeds[-1]
    assert refining_seeds(1, 6001, 0) == []
