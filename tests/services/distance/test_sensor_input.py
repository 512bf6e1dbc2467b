from collections import Counter

from schemas.keys import CameraKey
from services.distance.sensor_input import DetectionCounts


def test_what_became_of_detections_and_of_what_was_kept_for_them() -> None:
    tally = DetectionCounts(CameraKey("r1", "front"))
    tally.done += 3
    tally.malformed("detections")
    unused = Counter({"nothing of its instant was asked for": 2})
    for _ in range(2):
        tally.add("depth image", unused)
    tally.dropped["never"] += 0
    assert not unused
    load = tally.load(serving=True)
    assert (load.robot, load.camera, load.inferred, load.serving) == ("r1", "front", 3, True)
    assert load.dropped == {"malformed detections": 1, "depth image: nothing of its instant was asked for": 2}
