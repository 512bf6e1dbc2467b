from pathlib import Path

import numpy as np

from benchmarks.accuracy.drives import SENSORS
from benchmarks.worldmodel.recording import NOTHING, Recorder, shown_by, visible_in
from schemas.detections import Box, Detection
from services.simulator.placement import COLOR_OPTICAL, of_pose
from services.simulator.world import Drive, generate
from services.training.evaluation.truths import mask_of

SEED = 704


def test_a_detection_shows_the_object_that_its_mask_lies_on() -> None:
    scene = generate(SEED)
    seen = visible_in(scene, of_pose(Drive.plan(scene).pose(0.3)))
    largest = max(seen, key=lambda each: each.pixels)
    right = Detection(name=largest.name, score=0.9, box=Box(0, 0, 1, 1), mask=mask_of(largest))
    other = "pallet" if largest.name != "pallet" else "box"
    wrong = Detection(name=other, score=0.9, box=Box(0, 0, 1, 1), mask=mask_of(largest))
    assert shown_by([right, wrong], seen) == [largest.instance, NOTHING]
    assert shown_by([right], ()) == [NOTHING]


def test_a_round_is_recorded_once(tmp_path: Path) -> None:
    looked: list[object] = []

    def predict(image: object) -> list[Detection]:
        looked.append(image)
        return []

    recorder = Recorder(tmp_path / "kept", 0.1, predict, "digest")
    made = recorder.round(SEED, 1)
    assert len(looked) == len(made.images) > 0
    assert recorder.round(SEED, 1) == made
    assert len(looked) == len(made.images)
    assert {each.name for each in made.objects} <= {"box", "pallet", "forklift"}
    (first, *_) = made.images
    assert first.depth().shape == (SENSORS.color.height, SENSORS.color.width)
    assert np.array(first.pose).shape == (4, 4)
    assert first.detections.header.frame_id == COLOR_OPTICAL


def test_another_round_is_another_way_through_the_same_warehouse() -> None:
    scene = generate(SEED)
    assert Drive.plan(scene, 0).points[0].tolist() != Drive.plan(scene, 1).points[0].tolist()
