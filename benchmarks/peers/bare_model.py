"""Ultralytics' own prediction in a loop over images in memory. Arguments: runtime, longer side in pixels, seconds.

Each time it is asked it predicts for so many seconds and says how many images it did, and under which runtime: `auto`
is what the detector's own choice is.
"""

import shutil
import sys
import tempfile
import time
from itertools import cycle
from pathlib import Path
from typing import Any

from benchmarks.peers.answering import answer
from benchmarks.peers.views import views
from services.detector.runtime.loading import load
from services.detector.settings import SHIPPED_MODEL, DetectorSettings, default_cache

FORMATS = {"onnx": "onnx", "openvino": "openvino", "tensorrt": "engine"}


def bare(runtime: str, side: int, folder: Path) -> Any:
    """Return Ultralytics' model for a runtime."""
    from ultralytics.models import YOLO  # noqa: PLC0415 - kept off the network by then

    weights = shutil.copy(SHIPPED_MODEL, folder)
    if runtime in FORMATS:
        weights = YOLO(weights).export(format=FORMATS[runtime], dynamic=True, imgsz=side, device="cpu", verbose=False)
    return YOLO(weights, task="segment")


if __name__ == "__main__":
    side, seconds = int(sys.argv[2]), float(sys.argv[3])
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        settings = DetectorSettings.model_validate(
            {"runtime": sys.argv[1], "image_size": side, "device": "cpu", "cache": default_cache()}
        )
        chosen = load(settings, folder)
        chosen.close()
        threads = __import__("torch").get_num_threads()
        model = bare(chosen.facts.runtime, side, folder)
        images = views()
        options = {
            "imgsz": side,
            "conf": settings.confidence,
            "iou": settings.iou,
            "max_det": settings.max_detections,
            "retina_masks": True,
            "device": "cpu",
            "verbose": False,
        }
        model.predict(images[0], **options)
        __import__("torch").set_num_threads(threads)  # predict leaves it at cores - 1

        def measure() -> dict[str, object]:
            """Predict for a while."""
            began, done = time.monotonic(), 0
            for image in cycle(images):
                model.predict(image, **options)
                done += 1
                if time.monotonic() - began >= seconds:
                    break
            return {"fps": done / (time.monotonic() - began), "runtime": chosen.facts.runtime}

        answer(measure)
