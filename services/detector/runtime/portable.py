"""Makes one ONNX file of weights and their refiner, which runs without torch and says all that a worker must know."""

import base64
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from services.detector.model import ModelError
from services.detector.runtime.exported_model import AGNOSTIC, HEAD, REFINER, SOURCE
from services.detector.runtime.exporting import exported

if TYPE_CHECKING:
    from services.detector.runtime.weights import Weights

UNSTEADY: Final = ("date",)
"""Metadata that differs from one export of the same weights to the next."""

LEAST_HALVED: Final = 1024
"""Numbers of a tensor from which on it is kept in half precision: smaller ones take no room."""


def portable(weights: "Weights", longest: int) -> bytes:
    """Return weights as the content of an ONNX file. longest: longer side of the input in pixels; others work too.

    The file keeps weights in half precision, as Ultralytics' checkpoints do; they are computed in single precision.

    Raises:
        ModelError: the export failed, or what it needs is not installed.
    """
    try:
        import onnx  # noqa: PLC0415 - it may not be there
    except ModuleNotFoundError as error:
        raise ModelError("onnx is not installed; see fleetsight's extra [onnx]") from error
    from services.detector.runtime.refinement.exporting import onnx_of  # noqa: PLC0415 - it needs torch

    with tempfile.TemporaryDirectory(prefix="fleetsight-", ignore_cleanup_errors=True) as folder:
        made = exported(weights, "onnx", Path(folder), "cpu", longest, gpu="", spare=Path(folder) / "spare")
        model = onnx.load(made)
    entries = {each.key: each.value for each in model.metadata_props if each.key not in UNSTEADY}
    entries |= {HEAD: weights.head, SOURCE: weights.digest} | ({AGNOSTIC: str(True)} if weights.agnostic else {})
    if weights.refiner is not None:
        refiner = onnx.load_from_string(onnx_of(weights.refiner))
        _halve(refiner)
        entries[REFINER] = base64.b64encode(refiner.SerializeToString(deterministic=True)).decode("ascii")
    _halve(model)
    del model.graph.value_info[:]  # what runtimes work out by themselves
    del model.metadata_props[:]
    onnx.helper.set_model_props(model, dict(sorted(entries.items())))
    content: bytes = model.SerializeToString(deterministic=True)
    return content


def _halve(model: Any) -> None:
    """Keep the large tensors of an ONNX model in half precision; runtimes widen them once, as they load the model."""
    from onnx import TensorProto, helper, numpy_helper  # noqa: PLC0415 - as above

    widened = []
    for tensor in model.graph.initializer:
        if tensor.data_type != TensorProto.FLOAT:
            continue
        numbers, name = numpy_helper.to_array(tensor), tensor.name
        if numbers.size < LEAST_HALVED or np.abs(numbers).max() > np.finfo(np.float16).max:
            continue
        half = f"{name}.half"
        tensor.CopyFrom(numpy_helper.from_array(numbers.astype(np.float16), half))
        widened.append(helper.make_node("Cast", [half], [name], to=TensorProto.FLOAT))
    nodes = [*widened, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
