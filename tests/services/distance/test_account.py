from collections import Counter

from schemas.keys import CameraKey
from services.distance.sensor_input import DetectionCounts


def test_what_became_of_detections_and_of_what_was_kept_for_them() -> None:
    account = DetectionCounts(CameraKey("r1", "front"))
    account.done += 3
    account.malformed("detections")
    unused = Counter({"nothing of its instant was asked for": 2})
    for _ in range(2):
        account.add("depth image", unused)
    account.dropped["never"] += 0
    assert not unused
    load = account.load(serving=True)
    assert (load.robot, load.camera, load.inferred, load.serving) == ("r1", "front", 3, True)
    assert load.dropped == {"malformed detections": 1, "depth image: nothing of its instant was asked for": 2}
