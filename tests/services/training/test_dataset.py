from pathlib import Path

import cv2
import numpy as np

from services.simulator.world import CLASSES, Camera, Drive, generate, render, truth_of
from services.training.dataset import MIN_AREA, holdout_seed, labels_of, training_seed, views_of, write_dataset


def ignored(_stage: str, _done: int, _total: int) -> None:
    """Take progress reports."""


def write(folder: Path, workers: int = 1) -> Path:
    return write_dataset(folder, ignored, seed=9, images=3, holdout=1, workers=workers)


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.*") if path.suffix != ".yaml"}


def test_no_held_out_scene_is_trained_on() -> None:
    for seed in (0, 1, 7):
        trained = {training_seed(seed, index) for index in (0, 1, 499_999)}
        assert trained.isdisjoint({holdout_seed(seed, index) for index in (0, 1, 499_999)})
        assert training_seed(seed + 1, 0) > holdout_seed(seed, 499_999)


def test_views_are_the_same_for_the_same_seed() -> None:
    for (image, labels), (same_image, same_labels) in zip(views_of(11, 2), views_of(11, 2), strict=True):
        assert np.array_equal(image, same_image)
        assert [label.class_index for label in labels] == [label.class_index for label in same_labels]


def test_labels_are_the_masks_of_what_is_seen() -> None:
    for seed in (700, 702, 704):
        scene = generate(seed)
        pose, camera = Drive.plan(scene).pose(0.3), Camera()
        view = render(scene, pose, camera)
        large = {
            int(instance): view.instances == instance
            for instance in np.unique(view.instances[view.instances > 0])
            if (view.instances == instance).sum() > 10 * MIN_AREA * view.instances.size
        }
        labels = labels_of(truth_of(scene, view, pose, camera))
        assert len(labels) >= len(large) > 0
        for instance, mask in large.items():
            same = [label for label in labels if CLASSES[label.class_index] == scene.class_name(instance)]
            overlaps = []
            for label in same:
                filled = cv2.fillPoly(np.zeros(mask.shape, np.uint8), [label.polygon], 1).astype(bool)
                overlaps.append((filled & mask).sum() / (filled | mask).sum())
            assert max(overlaps) > 0.9, scene.class_name(instance)


def test_files_are_complete_and_do_not_depend_on_the_workers(tmp_path: Path) -> None:
    alone, together = tmp_path / "alone", tmp_path / "together"
    assert write(alone).read_text().count("\n") == 7
    write(together, workers=2)
    files = content(alone)
    assert files == content(together)
    assert sorted(path.split("/", 1)[0] for path in files) == ["images"] * 4 + ["labels"] * 4
    for path, data in files.items():
        for line in data.decode().splitlines() if path.startswith("labels") else ():
            name, *points = line.split()
            assert int(name) < len(CLASSES)
            assert len(points) >= 6
            assert all(0 <= float(value) <= 1 for value in points)


def test_scenes_that_are_there_are_not_rendered_again(tmp_path: Path) -> None:
    write(tmp_path)
    first = min((tmp_path / "images" / "train").iterdir())
    first.write_bytes(b"kept")
    label = tmp_path / "labels" / "val" / f"{holdout_seed(9, 0):09d}-0.txt"
    label.unlink()
    write(tmp_path)
    assert first.read_bytes() == b"kept"
    assert label.exists()
