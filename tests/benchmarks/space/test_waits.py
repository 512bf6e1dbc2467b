import numpy as np

from benchmarks.space.waits import waits_ms


def test_the_slower_odometry_is_the_longer_detections_wait() -> None:
    without, fast, slow = (float(np.mean(waits_ms(hz, 0.05))) for hz in (0, 100, 20))
    assert without < fast < slow
