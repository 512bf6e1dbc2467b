"""A refiner under OpenVINO."""

from typing import Any

from numpy.typing import NDArray

from services.detector.runtime.openvino_engine import request_of
from services.detector.runtime.refinement.closeups import CloseUps
from services.detector.runtime.refinement.refiner import Floats, Refined, refined


class OpenVinoRefiner:
    """Runs an ONNX file's content on the processor."""

    def __init__(self, model: bytes, threads: int) -> None:
        self._request = request_of(model, threads)

    def run(self, seen: CloseUps) -> Refined:
        """See `Refiner.run`."""
        return refined(seen, self._compute)

    def _compute(self, given: list[NDArray[Any]]) -> tuple[Floats, Floats]:
        found = self._request.infer(given, share_inputs=True)
        return found[0], found[1]
