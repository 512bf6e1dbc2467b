"""The detector's model on pictures, with nothing else at work. Arguments: runtime, cache, file of the pictures.

Each time it is asked it says how long the stages of a call take, in milliseconds, and under which runtime: `auto` is
the detector's own choice, out of its cache. The file is numpy's: pictures x height x width x 3, RGB.
"""

import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.answering import answer
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from services.detector.model import DetectedObjects, Request
from services.detector.runtime.loading import load
from services.detector.settings import DetectorSettings

ROUNDS: Final = 3


def request(picture: NDArray[np.uint8]) -> Request:
    """Return a picture as a gateway sends it."""
    height, width = picture.shape[:2]
    header = Header(robot="r1", camera="camera", boot_id="", seq=0, stamp_ns=0, frame_id="", received_ns=time.time_ns())
    frame = ImageFrame(
        header=header,
        height=height,
        width=width,
        encoding="rgb8",
        step=width * 3,
        data=memoryview(picture.tobytes()),
    )
    return Request(CameraKey("r1", "camera"), frame, masks=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        settings = DetectorSettings.model_validate({"runtime": sys.argv[1], "device": "cpu", "cache": sys.argv[2]})
        model = load(settings, Path(made))
        asked = [request(picture) for picture in np.load(sys.argv[3])]

        def measure() -> dict[str, object]:
            """Call it a few times with each."""
            outcomes = [outcome for _ in range(ROUNDS) for each in asked for outcome in model.run([each])]
            calls = [outcome.spans for outcome in outcomes if isinstance(outcome, DetectedObjects)]
            stages = {name: round(statistics.median(call[name] for call in calls) / 1e6, 3) for name in calls[0]}
            return {**stages, "runtime": model.facts.runtime}

        answer(measure)
        model.close()
