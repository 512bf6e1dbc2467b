from pathlib import Path

import numpy as np
import pytest

from schemas.detections import Box, Detection
from services.detector.runtime.offline import keep_offline
from tests.services.detector.requests import frame_of


@pytest.mark.parametrize("kind", ["bytetrack", "botsort"])
def test_what_moves_a_little_keeps_its_number_and_what_leaves_takes_it_along(kind: str, model_folder: Path) -> None:
    keep_offline(model_folder / "ultralytics", download=False)
    from services.detector.runtime.trackers import UltralyticsTracker  # noqa: PLC0415 - it must be offline by then

    tracker = UltralyticsTracker("botsort" if kind == "botsort" else "bytetrack")
    picture = np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8)

    def seen(step: int, *lefts: float) -> list[int | None]:
        objects = [Detection(name="box", score=0.8, box=Box(x, 20, x + 40, 60)) for x in lefts]
        return list(tracker.update(objects, frame_of(picture, seq=step)))

    first = seen(0, 10, 100, 200)
    assert sorted(number for number in first if number is not None) == [1, 2, 3]
    for step in range(1, 5):
        assert seen(step, 10 + step, 100 - step, 200) == first
    assert seen(5, 200, 15) == [first[2], first[0]]
    assert seen(6) == []
