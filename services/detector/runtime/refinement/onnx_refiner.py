"""A refiner under ONNX Runtime, on the processor."""

from typing import Any

import onnxruntime
from numpy.typing import NDArray

from services.detector.runtime.onnx_engine import HALF, providers, session_options
from services.detector.runtime.refinement.refiner import CloseUps, Floats, Refined, halved, refined


class OnnxRefiner:
    """Runs an ONNX file's content."""

    def __init__(self, model: bytes, threads: int) -> None:
        self._session = onnxruntime.InferenceSession(model, session_options(threads), providers=providers(None, ()))
        self._inputs = {each.name: each.type for each in self._session.get_inputs()}

    def run(self, seen: CloseUps) -> Refined:
        """See `Refiner.run`."""
        return refined(seen, self._compute)

    def _compute(self, given: list[NDArray[Any]]) -> tuple[Floats, Floats]:
        named = {
            name: halved(each) if kind == HALF else each  # features, in what earlier releases exported
            for (name, kind), each in zip(self._inputs.items(), given, strict=True)
        }
        odds, qualities = self._session.run(None, named)
        return odds, qualities
