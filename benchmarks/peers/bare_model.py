"""Ultralytics' own prediction in a loop over images in memory. Arguments: runtime, cache, seconds, device.

Each time it is asked it predicts for so many seconds and says how many images it did a second, and under which runtime:
`auto` is the detector's own choice without INT8, out of its cache. It computes with a detector's threads: Ultralytics
has no setting for those of an exported model, so the model that it compiled is replaced by one compiled with the
detector's settings.
"""

import shutil
import sys
import tempfile
import time
from itertools import cycle
from pathlib import Path
from typing import Any, Final

from benchmarks.peers.answering import answer
from benchmarks.peers.views import views
from services.detector.runtime.loading import load
from services.detector.runtime.offline import keep_offline
from services.detector.settings import SHIPPED_MODEL, DetectorSettings

EXPORTED: Final = ("onnx", "openvino")


def bare(runtime: str, options: dict[str, Any], threads: int, folder: Path) -> Any:
    """Return Ultralytics' model for a runtime, which has predicted once."""
    import torch  # noqa: PLC0415 - settings of the detector come first
    from ultralytics.models import YOLO  # noqa: PLC0415

    weights = shutil.copy(SHIPPED_MODEL, folder)
    if runtime in EXPORTED:
        weights = YOLO(weights).export(
            format=runtime, dynamic=True, imgsz=options["imgsz"], device=options["device"], verbose=False
        )
    model: Any = YOLO(weights, task="segment")
    model.predict(views()[0], **options)
    torch.set_num_threads(threads)  # predict leaves it at cores - 1
    backend = model.predictor.model.backend
    if runtime == "openvino":
        import openvino  # noqa: PLC0415

        from services.detector.runtime.openvino_engine import DEVICE, hints  # noqa: PLC0415

        (file,) = Path(weights).glob("*.xml")
        backend.ov_compiled_model = openvino.Core().compile_model(file, DEVICE, hints(threads))
    elif runtime == "onnx":
        import onnxruntime  # noqa: PLC0415

        from services.detector.runtime.onnx_engine import session_options  # noqa: PLC0415

        backend.session = onnxruntime.InferenceSession(
            weights, session_options(threads), providers=["CPUExecutionProvider"]
        )
    return model


if __name__ == "__main__":
    seconds = float(sys.argv[3])
    with tempfile.TemporaryDirectory() as made:
        settings = DetectorSettings.model_validate(
            {"runtime": sys.argv[1], "int8": False, "device": sys.argv[4], "cache": sys.argv[2]}
        )
        detectors = load(settings, Path(made))
        detectors.close()
        keep_offline(Path(made), download=False)
        options = {
            "imgsz": detectors.facts.longest,
            "conf": settings.confidence,
            "iou": settings.iou,
            "max_det": settings.max_detections,
            "retina_masks": True,
            "device": settings.device,
            "verbose": False,
        }
        model = bare(detectors.facts.runtime, options, settings.inference_threads, Path(made))
        images = views()

        def measure() -> dict[str, object]:
            """Predict for a while."""
            began, done = time.monotonic(), 0
            for image in cycle(images):
                model.predict(image, **options)
                done += 1
                if time.monotonic() - began >= seconds:
                    break
            fps = done / (time.monotonic() - began)
            return {"fps": fps, "runtime": detectors.facts.runtime, "side": detectors.facts.longest}

        answer(measure)
