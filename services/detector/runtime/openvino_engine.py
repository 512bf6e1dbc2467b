"""A model under OpenVINO, which reads ONNX files itself and takes pixels unchanged."""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.detector.runtime.engine import outputs
from services.detector.runtime.postprocess import Output
from services.detector.runtime.refinement.refiner import CloseUps, Floats, Refined, refined

sys.modules.setdefault("openvino_telemetry", None)  # type: ignore[arg-type]  # keeps it from being imported: it phones
import openvino  # noqa: E402

DEVICE: Final = "CPU"


def hints(threads: int) -> dict[str, Any]:
    """Return the configuration for this many threads."""
    return {
        "PERFORMANCE_HINT": "LATENCY",
        "INFERENCE_NUM_THREADS": threads,
        "ENABLE_CPU_PINNING": False,  # a core that somebody else keeps busy would hold up every layer
    }


def input_shape(path: Path) -> tuple[int | None, ...]:
    """Return the shape of a model's only input; None for sides of any length."""
    (given,) = openvino.Core().read_model(path).inputs
    return tuple(None if side.is_dynamic else side.get_length() for side in given.partial_shape)


class OpenVinoEngine:
    """Runs an ONNX file, its content or an .xml file on the CPU, in the precision that OpenVINO finds fastest there."""

    def __init__(self, model: Path | bytes, threads: int) -> None:
        # OpenVINO gives the thread that makes a model another stack for signals, and unmaps it with the model: where
        # that happens on another thread, the next signal kills the process. The thread that makes this one ends first.
        with ThreadPoolExecutor(1) as maker:
            self._request = maker.submit(_image_request, model, threads).result()

    def run(self, images: NDArray[np.uint8]) -> list[Output]:
        """See `Engine.run`."""
        found = self._request.infer([images], share_inputs=True)
        predictions, *prototypes = (np.asarray(found[index], np.float32) for index in range(len(found)))
        return outputs(predictions, prototypes[0] if prototypes else None)


class OpenVinoRefiner:
    """Runs a refiner, an ONNX file's content, on the CPU."""

    def __init__(self, model: bytes, threads: int) -> None:
        with ThreadPoolExecutor(1) as maker:  # as above
            self._request = maker.submit(_request, model, threads).result()

    def run(self, seen: CloseUps) -> Refined:
        """See `Refiner.run`."""
        return refined(seen, self._compute)

    def _compute(self, given: list[NDArray[Any]]) -> tuple[Floats, Floats]:
        found = self._request.infer(given, share_inputs=True)
        odds, qualities = (np.array(found[index], np.float32) for index in range(2))
        return odds, qualities


def _request(model: bytes, threads: int) -> openvino.InferRequest:
    core = openvino.Core()
    return core.compile_model(core.read_model(model), DEVICE, hints(threads)).create_infer_request()


def _image_request(model: Path | bytes, threads: int) -> openvino.InferRequest:
    core = openvino.Core()
    pixels = openvino.preprocess.PrePostProcessor(core.read_model(model))
    pixels.input().tensor().set_element_type(openvino.Type.u8).set_layout(openvino.Layout("NHWC"))
    pixels.input().model().set_layout(openvino.Layout("NCHW"))
    pixels.input().preprocess().convert_element_type(openvino.Type.f32).scale(255.0).convert_element_type()
    return core.compile_model(pixels.build(), DEVICE, hints(threads)).create_infer_request()
